"""The capture rig: convert a LIDAR's ranges to a depth map aligned with the camera's image."""
