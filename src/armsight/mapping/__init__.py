"""From depth frames to an immutable snapshot of the workspace."""
