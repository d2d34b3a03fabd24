"""The networks of T4 to T7, in PyTorch; importing this package needs no torch, its modules do."""
