"""The papers' own methods, as printed and corrected, for comparison and teaching; not used in a run."""
