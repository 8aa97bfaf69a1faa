"""What judges `balancer`: plots, figures, limits, margins of its loops."""
