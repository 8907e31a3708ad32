"""Only here Rerun is imported."""
