"""Training and transfer of the papers' networks; needs torch and numpy, nothing else of weight.

``python -m armsight.recognition.training`` is the same as ``armsight train`` on a machine that has
those two only, as a borrowed GPU does.
"""
