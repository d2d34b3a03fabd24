"""The mistakes that users of hand-eye tools report, found by name (design page, 5.8)."""
