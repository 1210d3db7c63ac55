"""Where a robot is: pose from odometry and IMU, frames from tags, tags from camera frames."""
