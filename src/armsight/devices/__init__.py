"""What an arm, a camera and a clock are: protocols and the data they exchange."""
