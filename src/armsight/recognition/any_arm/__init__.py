"""Any arm in one colour picture, joint angles unknown: a network on crops, then the kinematics."""
