"""What residuals a correct model leaves: sensor noise, and the simulator's own error."""
