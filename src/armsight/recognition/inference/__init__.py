"""Recognising the robot in a picture, with onnxruntime and no torch."""
