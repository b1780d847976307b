"""What race control's node and the bridge's have in common as ROS processes."""
