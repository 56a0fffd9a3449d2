"""Solids around a twin: what is pulled stops at them, pictures show them, and a log knows them."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from applications.generate.draws import Draws, Randomisation
from applications.generate.episode import Keypoints, at_rest, simulated
from applications.generate.grasps import candidates
from applications.generate.pictures import BACKGROUND, OBJECT, Studio
from applications.play.film import Log
from applications.play.pulls import write_log
from applications.twin import Twin
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import Mesh, save_mesh
from physreal_core.playing import replayed
from pipeline.cli import main
from tests.fitting import scene

WALL = 0.17
"""Where the wall's face is, 3 cm from the bar's end [m]."""


def wall(folder: Path, lower=(WALL, -0.1, 0.0), upper=(WALL + 0.03, 0.16, 0.12)) -> Path:
    import trimesh

    box = trimesh.creation.box(bounds=[lower, upper])
    save_mesh(folder / "wall.glb", Mesh(np.array(box.vertices), np.array(box.faces)))
    return folder / "wall.glb"


@pytest.fixture
def walled(project, tmp_path) -> Twin:
    return Twin.load(project, "lift", scene=wall(tmp_path))


def pulled_to_the_wall(session) -> np.ndarray:
    """The bar's free end drawn 10 cm towards the wall, by places of the particles [m]."""
    session.let_hand("open")
    end = session.take(np.array([0.13, 0.03, 0.03]))
    session.move(end, np.array([0.25, 0.03, 0.03]))
    states = [session.step().x.numpy().copy() for _ in range(30)]
    return np.stack(states)


def test_what_is_pulled_stops_at_a_wall(twin, walled):
    free, stopped = pulled_to_the_wall(twin.session()), pulled_to_the_wall(walled.session())
    half = scene.SPACING / 2
    assert free[-1, :, 0].max() > WALL + 0.02
    assert stopped[:, :, 0].max() < WALL - half + 0.002  # half a particle before it, but for what it sinks in
    assert stopped[-1, :, 0].max() > WALL - half - 0.01


def test_a_thin_wall_is_found_as_thick_as_it_is(project, tmp_path):
    thin = Twin.load(project, "lift", scene=wall(tmp_path, upper=(WALL + 0.004, 0.16, 0.12))).scene.solids
    inside = thin.at(torch.tensor([[WALL + 0.002, 0.03, 0.05], [WALL - 0.005, 0.03, 0.05]], dtype=torch.float64))
    assert float(inside[0]) == pytest.approx(-0.0018, abs=4e-4) and float(inside[1]) == pytest.approx(0.005, abs=1e-5)


def test_a_log_knows_the_solids(project, walled, tmp_path, monkeypatch):
    session = walled.session()
    states = pulled_to_the_wall(session)
    log = Log.read(write_log(tmp_path, walled, session))
    assert log.scene == walled.scene.path
    again = np.stack([s.x.numpy().copy() for s in replayed(walled.session(), log.actions, log.frames)])
    assert np.array_equal(again, states)
    monkeypatch.chdir(project.root)
    with pytest.raises(SystemExit) as ended:
        main(["play", "--replay", str(tmp_path), "--record", str(tmp_path / "again.mp4")])
    assert ended.value.code == 0
    with np.load(tmp_path / "again.npz") as file:
        assert np.array_equal(file["x"], states)


def test_pictures_show_the_solids_and_masks_leave_them_out(twin, walled):
    seen = {}
    for name, own in (("without", twin), ("with", walled)):
        session = own.session()
        studio = Studio(own, session.floor)
        at_rest(session, own.model.fields)
        place = candidates(own, own.surface(session.state), 1, 0)[0]
        draws = Draws(place[None], None, studio.camera, Randomisation.none(), 60, session.fps, session.floor, seed=3)
        draw = draws.draw(0)
        motion = dataclasses.replace(simulated(session, Keypoints(own), place, draw.way))
        seen[name] = studio.pictures(motion, draw)
    with_it, without = seen["with"], seen["without"]
    nearer = (with_it.depth[0] > 0) & ((without.depth[0] == 0) | (with_it.depth[0] < without.depth[0] - 0.01))
    assert nearer.sum() > 100
    assert (with_it.mask[0][nearer] == BACKGROUND).mean() > 0.95
    assert np.abs(with_it.flow[0][nearer & (with_it.mask[0] == BACKGROUND)]).mean() < 0.1
    assert (with_it.mask[0] == OBJECT).sum() > 0.5 * (without.mask[0] == OBJECT).sum()


def test_a_plan_goes_around_by_the_same_simulation(walled):
    """What plans are made with knows the solids, too."""
    from physreal_core.planning import Forecast

    forecast = Forecast(walled.problem, walled.model, walled.mesh.vertices[:8])
    assert forecast.rollouts.problem.solids is walled.scene.solids


def test_what_is_no_scene_is_refused(project, twin, tmp_path, monkeypatch, capsys):
    inside = wall(tmp_path, lower=(0.1, 0.0, 0.0))
    with pytest.raises(InputError, match=r"particles lie within a solid.*move the solids"):
        Twin.load(project, "lift", scene=inside)
    monkeypatch.chdir(project.root)
    for arguments in (["play", "lift", "--record", "a.mp4"], ["generate", "lift"]):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, "--scene", str(tmp_path / "none.glb")])
        assert ended.value.code == 2 and "none.glb" in capsys.readouterr().err


def test_the_search_refuses_solids(walled):
    from physreal_core.gap import Experiment

    with pytest.raises(InputError, match="solids around the body"):
        Experiment(walled.problem, walled.model)
