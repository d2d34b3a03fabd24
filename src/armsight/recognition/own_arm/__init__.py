"""The pose of a camera from what it sees of the arm at work, where the joint angles are known."""
