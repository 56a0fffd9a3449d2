"""Plans for a hand: where it has to go so that the fitted body comes to be where it is wanted, and what becomes of them.

```python
forecast, grasps = Forecast(problem, model, points0), grasps_of(problem)
planner = Planner(forecast, Cost(PointsToPlaces(numbers, places)), grasps, Bounds(lower, upper, speed=0.5))
execution = execute(planner, robot, every=10)
```
"""

from physreal_core.planning.ensemble import members
from physreal_core.planning.forecast import Forecast, Seen
from physreal_core.planning.goal import Cost, PointsToPlaces, Silhouette, TargetShape
from physreal_core.planning.holding import grasps_at, grasps_of, quick_form, with_grip
from physreal_core.planning.path import Bounds, Grasps, Way
from physreal_core.planning.planner import Plan, PlanConfig, Planner
from physreal_core.planning.predictive import Execution, Executor, execute
from physreal_core.planning.search import SearchConfig

__all__ = [
    "Bounds",
    "Cost",
    "Execution",
    "Executor",
    "Forecast",
    "Grasps",
    "Plan",
    "PlanConfig",
    "Planner",
    "PointsToPlaces",
    "SearchConfig",
    "Seen",
    "Silhouette",
    "TargetShape",
    "Way",
    "execute",
    "grasps_at",
    "grasps_of",
    "members",
    "quick_form",
    "with_grip",
]
