"""The loop on a clock: components, snapshots between them, recording, replay, health."""
