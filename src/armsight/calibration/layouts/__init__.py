"""What people have on disk: pictures, poses, lenses and corners in whatever layout they keep them.

One file a format. Every reader yields a :class:`~armsight.calibration.layouts.table.PoseTable`:
rows of numbers with the names that tie them to pictures, and what the file itself says about them.
What the numbers mean is decided later (``conventions``, ``choice``), by the pictures.
"""
