"""The capture rig: from a LIDAR's ranges to a depth map on the camera's image."""
