"""What a cell believes of its cameras and its arm: the calibration file beside the cell's file."""
