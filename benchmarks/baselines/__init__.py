"""Other ways to a body that moves like the filmed one, written from their papers, on the same captures.

Each module has `fit(scene, seconds)`, which sees what our fit sees of a sequence, and gives a `Fitted` that moves the body there and in
another motion. Published codes are for cards and for recordings of another kind; here all run in one harness on one machine.
"""
