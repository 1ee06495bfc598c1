"""What ROS robots recorded or send: read, published, and written of simulated robots."""
