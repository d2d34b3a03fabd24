"""From a goal and a snapshot to a joint velocity command that touches nobody."""
