"""What ours is measured against, and what tests take as a second opinion; no part of the package.

T2's map (cleaned and merged clouds in OctoMap) and OMPL's planners behind our protocols. They need
packages of the dependency group ``dev`` (``ompl``, ``octomap-python``, ``small-gicp``).
"""
