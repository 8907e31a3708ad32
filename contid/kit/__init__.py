"""What drivers share: a locked serial port, ports by adapter, the memory of devices, deferred signals."""
