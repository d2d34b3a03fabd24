"""What the arm is asked to do, one file a task; a task publishes intents, the guard commands."""
