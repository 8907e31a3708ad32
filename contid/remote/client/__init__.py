"""Clients of the socket, synchronous and asyncio."""
