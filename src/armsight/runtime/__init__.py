"""The loop on a clock: components, what they hand each other, health."""
