"""The schema of workcell.toml, its checks, and building devices from it."""
