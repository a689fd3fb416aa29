"""What turns a camera and a tunnel into numbers that can be trusted."""
