"""What the robot's side computes from what it receives: estimates of targets from camera frames."""
