"""A twin beside the real thing: it follows a stream of measurements, says how sure it is, and tells when it no longer understands."""

from physreal_core.following.alarm import Alarm
from physreal_core.following.careful import CarefulFollower, follower_of
from physreal_core.following.follower import FollowConfig, Follower
from physreal_core.following.stream import Followed, Seen

__all__ = ["Alarm", "CarefulFollower", "FollowConfig", "Followed", "Follower", "Seen", "follower_of"]
