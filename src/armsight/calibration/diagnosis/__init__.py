"""The mistakes that users of hand-eye tools report, found by name (docs/calibration.md)."""
