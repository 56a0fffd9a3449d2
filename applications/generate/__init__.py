"""`physreal generate`: episodes of a hand that takes the fitted twin and moves it, as data for robots."""
