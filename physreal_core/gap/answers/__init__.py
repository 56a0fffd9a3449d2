"""From fits to an answer: probabilities, the verdict, and how far each model is from the measurement."""
