"""Robot description of tendon robots: sections in series on one backbone, bent by tendons on spools."""
