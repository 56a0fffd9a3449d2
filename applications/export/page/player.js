// Plays Gaussians frame by frame: orbit with the mouse, play and pause, go to a frame.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { PackedSplats, SparkRenderer, SplatMesh, setPackedSplat } from "@sparkjsdev/spark";

const COLUMNS = 10, FULL = 65535;
const element = name => document.getElementById(name);

export async function start(scene, motion, colours) {
  const view = viewOf(scene);
  const numbers = new Uint16Array(motion), rgba = new Uint8Array(colours);
  const splats = new PackedSplats({ packedArray: packed(scene, numbers, rgba, 0), numSplats: scene.splats });
  const mesh = new SplatMesh({ packedSplats: splats });
  view.world.add(mesh);
  await mesh.initialized;
  const frames = new Map([[0, splats.packedArray]]);

  function show(frame) {
    if (!frames.has(frame)) frames.set(frame, packed(scene, numbers, rgba, frame));
    splats.packedArray.set(frames.get(frame));
    splats.needsUpdate = true;
    mesh.updateVersion();
    element("time").value = frame;
    element("frame").textContent = `${(frame / scene.fps).toFixed(2)} s`;
  }
  frames.set(0, splats.packedArray.slice());
  controlled(scene, view, show);
  element("told").textContent = scene.title;
}

// One frame as Spark keeps it, four 32-bit words a Gaussian.
function packed(scene, numbers, rgba, frame) {
  const { splats, low, high, largest } = scene, words = new Uint32Array(4 * Math.ceil(splats / 2048) * 2048);
  const place = (share, axis) => low[axis] + share / FULL * (high[axis] - low[axis]);
  for (let n = 0, at = frame * splats * COLUMNS; n < splats; n++, at += COLUMNS) {
    const size = k => numbers[at + 3 + k] / FULL * largest, turn = k => numbers[at + 6 + k] / FULL * 2 - 1;
    const colour = k => rgba[4 * n + k] / 255;
    setPackedSplat(
      words, n, place(numbers[at], 0), place(numbers[at + 1], 1), place(numbers[at + 2], 2), size(0), size(1), size(2),
      turn(0), turn(1), turn(2), turn(3), colour(3), colour(0), colour(1), colour(2),
    );
  }
  return words;
}

function viewOf(scene) {
  const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
  renderer.setClearColor(0xedf0f5);
  document.body.prepend(renderer.domElement);
  const world = new THREE.Scene(), camera = new THREE.PerspectiveCamera(scene.fov, 1, 0.01, 50);
  camera.up.set(0, 0, 1);
  camera.position.fromArray(scene.eye);
  const controls = new OrbitControls(camera, renderer.domElement);
  controls.target.fromArray(scene.target);
  world.add(new SparkRenderer({ renderer }));
  const fit = () => {
    renderer.setSize(innerWidth, innerHeight);
    camera.aspect = innerWidth / innerHeight;
    camera.updateProjectionMatrix();
  };
  addEventListener("resize", fit);
  fit();
  return { renderer, world, camera, controls };
}

// Time goes at the film's pace while it plays, and begins again after the last frame.
function controlled(scene, view, show) {
  let playing = true, began = performance.now(), shown = -1;
  const last = scene.frames - 1, slider = element("time"), button = element("play");
  const go = frame => { if (frame !== shown) show(shown = frame); };
  slider.max = last;
  button.onclick = () => {
    playing = !playing;
    began = performance.now() - 1000 * shown / scene.fps;
    button.textContent = playing ? "Pause" : "Play";
  };
  slider.oninput = () => {
    if (playing) button.click();
    go(Number(slider.value));
  };
  view.renderer.setAnimationLoop(now => {
    if (playing) go(Math.floor(Math.max(now - began, 0) / 1000 * scene.fps) % scene.frames);
    view.controls.update();
    view.renderer.render(view.world, view.camera);
  });
}
