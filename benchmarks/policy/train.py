"""Trains the policy: `python -m benchmarks.policy.train EXAMPLES --to policy.pt --device cuda`

EXAMPLES is what `benchmarks.policy.episodes` wrote. The last tenth, episodes that nothing else is learnt from, say when to stop: what a hand does next is
partly chance, and a network can learn chance by heart. Needs numpy and torch alone.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import torch

from benchmarks.policy.episodes import Examples
from benchmarks.policy.network import SCALE, Policy
from physreal_core.array_types import Float, Tensor, UInt8

BATCH, RATE, KEPT_BACK, LOOK = 256, 1e-3, 0.1, 250
"""Examples of a step, largest rate, share that is kept back, and steps after which it is looked at."""

DECAY = 1e-2
"""Of the weights."""

HOLES, GRAIN = 0.03, 3.0
"""Share of the depth readings that are dropped, and grain of colour [grey levels] and heights [mm], as a sensor has them."""


def main() -> None:
    """Train, and keep the weights."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.policy.train", description=__doc__)
    parser.add_argument("examples", type=Path, nargs="+")
    parser.add_argument("--to", type=Path, required=True)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    begun = time.perf_counter()
    parts = [Examples.load(path) for path in arguments.examples]
    device = torch.device(arguments.device)
    policy, told = trained(parts, device, arguments.steps, arguments.seed)
    told |= {"seconds": time.perf_counter() - begun, "steps": arguments.steps}
    told["machine"] = torch.cuda.get_device_name() if device.type == "cuda" else "CPU"
    told["examples"] = sum(len(part.hand) for part in parts)
    told["parameters"] = sum(weights.numel() for weights in policy.parameters())
    torch.save({"weights": policy.cpu().state_dict(), "training": told}, arguments.to)
    print(told)


def trained(parts: list[Examples], device: torch.device, steps: int, seed: int) -> tuple[Policy, dict[str, float]]:
    """The policy that is least surprised by what was kept back, and what is known of it: its surprise by that and by the rest, and its step."""
    torch.manual_seed(seed)
    arrays = {
        name: torch.from_numpy(np.concatenate([getattr(part, name) for part in parts])).to(device)
        for name in Examples.__dataclass_fields__
    }
    rows = torch.arange(len(arrays["hand"]), device=device)
    own, kept_back = rows[: -int(KEPT_BACK * len(rows))], rows[-int(KEPT_BACK * len(rows)) :]
    policy, best, least, when = Policy().to(device), {}, np.inf, 0
    adam = torch.optim.AdamW(policy.parameters(), lr=RATE, weight_decay=DECAY)
    rates = torch.optim.lr_scheduler.OneCycleLR(adam, RATE, total_steps=steps)
    for step in range(1, steps + 1):
        drawn = own[torch.randint(len(own), (BATCH,), device=device)]
        loss = _surprise(policy, arrays, drawn, noisy=True)
        adam.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(policy.parameters(), 1.0)
        adam.step()
        rates.step()
        if step % LOOK == 0 or step == steps:
            there = _mean(policy, arrays, kept_back)
            print(step, f"{loss.item():.3f}", f"{there:.3f}", flush=True)
            if there < least:
                best, least, when = {name: w.clone() for name, w in policy.state_dict().items()}, there, step
    policy.load_state_dict(best)
    return policy, {"surprise": _mean(policy, arrays, own), "surprise_kept_back": least, "stopped": when}


@torch.no_grad()
def _mean(policy: Policy, arrays: dict[str, Tensor], rows: Tensor) -> float:
    parts = rows.split(BATCH)
    return sum(float(_surprise(policy, arrays, part)) * len(part) for part in parts) / len(rows)


def _surprise(policy: Policy, arrays: dict[str, Tensor], rows: Tensor, noisy: bool = False) -> Float[Tensor, ""]:
    colour, heights = arrays["colour"][rows], arrays["heights"][rows]
    if noisy:
        colour, heights = _grained(colour), _grained(heights) * (torch.rand(heights.shape, device=rows.device) > HOLES)
    ways = policy(colour, heights, arrays["hand"][rows])
    return ways.surprise(arrays["places"][rows] / SCALE, arrays["closed"][rows]).mean()


def _grained(values: UInt8[Tensor, "*shape"]) -> UInt8[Tensor, "*shape"]:
    grain = GRAIN * torch.randn(values.shape, device=values.device)
    return (values.float() + grain).round().clamp(0, 255).to(torch.uint8)


if __name__ == "__main__":
    main()
