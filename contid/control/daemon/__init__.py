"""The asyncio daemon: input, supervision of the control process, report."""
