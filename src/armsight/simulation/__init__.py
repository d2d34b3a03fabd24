"""The MuJoCo world of a workcell: physics, rendering, sensor errors, people."""
