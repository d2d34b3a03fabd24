"""Skips where torch is missing: no lock holds it (docs/recognition.md says how to get it).

Modules whose tests need it begin with ``from ..torch_or_skip import torch``.
"""

import pytest

torch = pytest.importorskip(
    "torch", reason="PyTorch is not installed (an extra: see docs/recognition.md)"
)
