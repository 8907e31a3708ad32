"""What drivers share: a locked serial port, ports by adapter, and the memory of devices."""
