"""What is wrong with the measurement; corrected in the observation, never in the object.

A capture with a camera saw object and hand through it: where that errs by `seen = s(true)`, the hand's recorded path
is read as s^-1 of itself, and the object's points are compared as s of theirs. A capture without a camera has its hand
from elsewhere (a robot's joints), which the error does not touch.
"""
