"""High-speed train: satellites, inertial sensors and odometer fused, through tunnels."""
