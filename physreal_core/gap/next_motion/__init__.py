"""The motion to film next: a library for a hand, and what each motion would tell about which answer is right."""
