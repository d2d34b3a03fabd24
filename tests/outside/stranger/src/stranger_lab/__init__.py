"""What a laboratory adds to armsight: its camera, its arm, and a task."""
