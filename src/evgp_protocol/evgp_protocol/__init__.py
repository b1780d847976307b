"""What goes over the wire between the EVGP race control and a kart; needs no ROS."""
