"""Bodies that are robots of ROS 2: what their topics say as samples of sensors, and wheel commands as topics."""
