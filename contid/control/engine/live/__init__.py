"""What follows a live stream: its clock, the curve through its rows, straight lines to rows that jump."""
