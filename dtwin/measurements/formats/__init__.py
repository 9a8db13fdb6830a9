"""Single kinds of files: text, and recordings of ROS 2."""
