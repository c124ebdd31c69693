"""The capture rig: from a LIDAR's ranges to a depth map that lies on the camera's image."""
