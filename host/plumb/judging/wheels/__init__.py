"""What judges `wheels`: plots, figures, limits, margins of its loops."""
