"""The live procedure: an arm moves a board before cameras until all are calibrated."""
