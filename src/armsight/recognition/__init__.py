"""Recognising a robot arm in one colour image (T4 to T7): data, networks, training, inference."""
