"""What several commands share: option types, tables, rows, progress."""
