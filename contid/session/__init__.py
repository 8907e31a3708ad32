"""What happened: record, read, replay, compare, export."""
