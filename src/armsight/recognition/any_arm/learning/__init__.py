"""The network of :mod:`armsight.recognition.any_arm` in PyTorch, and how it is trained."""
