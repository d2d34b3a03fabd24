"""What may be servoed to, one file a target."""
