"""The papers' own methods, as printed and corrected, for comparison and teaching; no robot runs on them."""
