// The merged map in 3-D: points, paths, keyframes, closures, radio links.  Drawn when something changes only.
import {
  Box3, BufferAttribute, BufferGeometry, Color, ColorManagement, Group, LinearSRGBColorSpace, PerspectiveCamera, Points, PointsMaterial,
  Scene, TOUCH, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { Line2 } from "three/examples/jsm/lines/Line2.js";
import { LineGeometry } from "three/examples/jsm/lines/LineGeometry.js";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";
import { decode } from "./decode.js";
import { el, figure, name, palette, toggles } from "./dom.js";
import { nearest } from "./picking.js";
import { report } from "./report.js";

ColorManagement.enabled = false; // colours as the page has them, no lighting
const LAYERS = ["map", "paths", "keyframes", "accepted", "rejected", "radio", "truth", "before", "chosen"];
const HIDDEN = ["rejected", "radio", "truth", "before"];
const SLANTED = new Vector3(-0.4, -0.8, 1), ABOVE = new Vector3(0, -0.001, 1);

export async function scene3d(run, onClosure) {
  const canvas = el("canvas", { tabindex: "0", role: "application",
    "aria-label": `${run.map ? "Merged map" : "Paths"} in 3-D of ${run.robots.map((r) => r.name).join(", ")}. Arrow keys turn it, plus and minus zoom. All that it shows stands in the tables below.` });
  const hint = el("output", { class: "hint" });
  const frame = el("div", { class: "scene" }, canvas, hint);
  let renderer;
  try {
    renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
  } catch {
    return { node: el("p", { class: "note" }, "This browser draws no WebGL; the pictures beside the report show the same from above."), highlight() {} };
  }
  renderer.outputColorSpace = LinearSRGBColorSpace;
  const scene = new Scene(), camera = new PerspectiveCamera(50, 1, 0.1, 1e5);
  camera.up.set(0, 0, 1);
  const controls = orbit(camera, canvas);

  const groups = Object.fromEntries(LAYERS.map((layer) => [layer, new Group()]));
  scene.add(...Object.values(groups));
  for (const layer of HIDDEN) groups[layer].visible = false;
  const pickable = [];
  const map = await mapPoints(run);
  if (map) groups.map.add(map.points);
  const apart = sideBySide();
  for (const robot of run.robots) await addRobot(robot, groups, pickable, apart);
  addClosures(run, groups, pickable);
  await addRadio(run, groups, pickable);

  const view = { after: extentOf(pickable, "keyframes", map?.xyz), before: extentOf(pickable, "before") };
  let asked = false, sized = false;
  const render = () => {
    asked = false;
    renderer.render(scene, camera);
    frame.dataset.drawn = String(Number(frame.dataset.drawn ?? 0) + 1);
  };
  const draw = () => {
    if (asked || !sized) return; // without a graphics card one drawing takes a second: none is to be in vain
    requestAnimationFrame(render);
    asked = true;
  };
  const look = (direction, of = groups.before.visible ? view.before : view.after) => {
    const { target, far } = framed(of, direction, camera);
    controls.target.copy(target);
    camera.position.copy(target).addScaledVector(direction.clone().normalize(), far);
    [camera.near, camera.far] = [of.radius / 500, of.radius * 50];
    camera.updateProjectionMatrix();
    controls.update();
    draw();
  };
  const resize = () => {
    const { clientWidth: width, clientHeight: height } = frame;
    if (!width || !height) return;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    const first = !sized;
    sized = true;
    first ? look(SLANTED) : draw();
  };
  const recolour = () => {
    if (!frame.isConnected && sized) return;
    const colour = palette();
    scene.background = new Color(colour("canvas"));
    scene.traverse((node) => node.userData.colour && node.material.color.set(colour(node.userData.colour)));
    map?.paint(scene.background);
    if (sized) render(); // at once: before printing there is no later
  };
  controls.addEventListener("change", draw);
  new ResizeObserver(resize).observe(frame);
  document.addEventListener("themechange", recolour);
  recolour();

  const find = (event) => nearest(pickable, groups, event, canvas, camera);
  const tell = (found) => (hint.textContent = found ? found.says : "");
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons) return;
    const found = find(event);
    tell(found);
    canvas.style.cursor = found?.closure === undefined ? "grab" : "pointer";
  });
  canvas.addEventListener("pointerdown", () => canvas.focus({ preventScroll: true }));
  canvas.addEventListener("click", (event) => {
    const found = find(event);
    tell(found);
    if (found?.closure !== undefined) onClosure(found.closure);
  });
  canvas.addEventListener("keydown", (event) => turned(event, camera, controls) && draw());

  const highlight = (index) => {
    groups.chosen.clear();
    const ends = run.closures[index]?.ends;
    if (ends) groups.chosen.add(segments(ends, "chosen", 5));
    recolour();
  };
  return { node: el("div", {}, controlsBar({ run, groups, map, draw, look }), frame, el("p", { class: "note hands-on" },
    `Drag to turn, right button or two fingers to move; click the picture, then scroll to zoom. Point at ${run.closures.length ? "a keyframe, closure or link to see what it is; click a closure to see its evidence" : "a keyframe or link to see what it is"}.`)), highlight };
}

function orbit(camera, canvas) {
  const controls = new OrbitControls(camera, canvas);
  controls.enableDamping = false;
  controls.zoomToCursor = true;
  controls.touches = { ONE: TOUCH.ROTATE, TWO: TOUCH.DOLLY_PAN };
  canvas.style.touchAction = "pan-y"; // one finger up or down scrolls the page, as the wheel does until the picture has focus
  controls.enableZoom = false;
  canvas.addEventListener("focus", () => (controls.enableZoom = true));
  canvas.addEventListener("blur", () => (controls.enableZoom = false));
  return controls;
}

function turned(event, camera, controls) {
  const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
  const zoom = { "+": 0.85, "=": 0.85, "-": 1 / 0.85 }[event.key];
  if (!turn && !zoom) return false;
  const offset = camera.position.clone().sub(controls.target);
  if (zoom) offset.multiplyScalar(zoom);
  else {
    const far = offset.length(), azimuth = Math.atan2(offset.y, offset.x) + turn[0];
    const height = Math.min(1.55, Math.max(-1.55, Math.asin(offset.z / far) + turn[1]));
    offset.set(far * Math.cos(height) * Math.cos(azimuth), far * Math.cos(height) * Math.sin(azimuth), far * Math.sin(height));
  }
  event.preventDefault();
  camera.position.copy(controls.target).add(offset);
  controls.update();
  return true;
}

function controlsBar({ run, groups, map, draw, look }) {
  const show = (layer) => (on) => ((groups[layer].visible = on), draw());
  const has = (layer) => groups[layer].children.length > 0;
  const layers = [
    ["map", "map", true], ["paths", "paths", true], ["keyframes", "keyframes", true],
    ["accepted", "accepted closures", true], ["rejected", "rejected closures", false], ["radio", "radio links", false], ["truth", "ground truth", false],
  ].filter(([layer]) => has(layer)).map(([layer, label, checked]) => ({
    layer, label, checked, change: show(layer), swatch: ["accepted", "rejected", "radio", "truth"].includes(layer) ? `var(--${layer})` : undefined,
  }));
  const robots = run.robots.map((robot, k) => ({
    label: robot.connected ? robot.name : `${robot.name} (not connected)`, checked: true, swatch: robot.colour,
    change: (on) => {
      for (const group of Object.values(groups)) for (const child of group.children) if (child.userData.robot === k) child.visible = on;
      map?.show(k, on);
      draw();
    },
  }));
  const shown = toggles("Show", layers);
  const when = (before) => () => {
    groups.before.visible = before;
    const checks = shown.querySelectorAll("input");
    layers.forEach(({ layer }, k) => {
      checks[k].disabled = before;
      groups[layer].visible = !before && checks[k].checked;
    });
    groups.chosen.visible = !before;
    if (colouring) colouring.disabled = before;
    look(before ? ABOVE : SLANTED);
  };
  const colours = map ? Object.keys(map.colours).map((by, k) => ({ label: by, value: by, checked: k === 0, change: () => (map.colourBy(by), draw()) })) : [];
  const colouring = colours.length ? toggles("Map's colours by", colours, { type: "radio", group: "map-colours" }) : null;
  const view = (label, direction) => el("button", { type: "button", onclick: () => look(direction) }, label);
  return el("div", { class: "controls" },
    shown,
    toggles("Robots", robots),
    run.map || has("accepted") || run.robots.length > 1
      ? toggles("When", [{ label: report.kind === "filter" ? "as the radio aligns them" : "after merging", checked: true, value: "after", change: when(false) },
          { label: "before: each robot in its own frame", value: "before", change: when(true) }], { type: "radio", group: "when" })
      : null,
    colouring,
    el("div", { class: "buttons" }, view("from above", ABOVE), view("slanted", SLANTED)));
}

async function mapPoints(run) {
  if (!run.map) return null;
  const [xyz, robot, intensity] = await Promise.all([run.map.xyz, run.map.robot, run.map.intensity].map(decode));
  const n = robot.length, [low, high] = run.map.heights_m, hidden = new Set();
  const geometry = positions(xyz);
  const rgb = new BufferAttribute(new Uint8Array(3 * n), 3, true);
  geometry.setAttribute("color", rgb);
  const robotColours = run.robots.map((r) => new Color(r.colour));
  const ramp = (share) => {
    // from blue over teal to yellow: ordered in lightness too
    const s = Math.min(1, Math.max(0, share)), clamp = (v) => Math.min(1, Math.max(0, v));
    return new Color(clamp(2.2 * s - 0.9), 0.25 + 0.65 * s, Math.max(0.1, 0.75 - 0.65 * s));
  };
  const steps = Array.from({ length: 64 }, (_, k) => ramp(k / 63));
  const colours = {
    robot: [robotColours, (i) => robot[i] % robotColours.length],
    height: [steps, (i) => Math.min(63, Math.max(0, Math.round((63 * (xyz[3 * i + 2] - low)) / Math.max(high - low, 1e-3))))],
  };
  if (intensity) {
    // 0: not known
    const shades = Array.from({ length: 33 }, (_, k) => (k ? ramp((k - 1) / 31) : new Color(0.5, 0.5, 0.5)));
    colours.intensity = [shades, (i) => intensity[i]];
  }
  let by = "robot", background = new Color(1, 1, 1);
  const paint = () => {
    const [table, which] = colours[by];
    const mixed = table.map((c) => c.clone().lerp(background, 0.35)).map((c) => [c.r, c.g, c.b].map((v) => Math.round(255 * v))); // paler than the paths
    for (let i = 0; i < n; i++) rgb.array.set(mixed[which(i)], 3 * i);
    rgb.needsUpdate = true;
  };
  return {
    xyz,
    points: new Points(geometry, new PointsMaterial({ size: 1.5, sizeAttenuation: false, vertexColors: true })),
    colours,
    colourBy(name) {
      by = name;
      paint();
    },
    paint(colour) {
      background = colour;
      paint();
    },
    show(k, on) {
      on ? hidden.delete(k) : hidden.add(k);
      const rows = Uint32Array.from(robot.keys()).filter((i) => !hidden.has(robot[i]));
      geometry.setIndex(hidden.size ? new BufferAttribute(rows, 1) : null);
    },
  };
}

const positions = (array) => new BufferGeometry().setAttribute("position", new BufferAttribute(array, 3));

function path(xyz, color, linewidth, robot) {
  const line = new Line2(new LineGeometry().setPositions(xyz), new LineMaterial({ color, linewidth }));
  line.userData.robot = robot;
  return line;
}

// Pairs of ends; its colour is one of the page's, so that it follows light and dark.
function segments(ends, colour, linewidth) {
  const lines = new LineSegments2(new LineSegmentsGeometry().setPositions(ends), new LineMaterial({ linewidth }));
  lines.userData.colour = colour;
  return lines;
}

// Moves each path to the right of those before it.
function sideBySide() {
  let edge = 0;
  return (xyz) => {
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (let i = 0; i < xyz.length; i++) if (i % 3 < 2) [low[i % 3], high[i % 3]] = [Math.min(low[i % 3], xyz[i]), Math.max(high[i % 3], xyz[i])];
    for (let i = 0; i < xyz.length; i += 3) {
      xyz[i] += edge - low[0];
      xyz[i + 1] -= (low[1] + high[1]) / 2;
    }
    edge += 1.15 * (high[0] - low[0]) + 2;
  };
}

async function addRobot(robot, groups, pickable, apart) {
  const number = groups.paths.children.length;
  const [merged, odometry, keyframes, times, truth] = await Promise.all(
    [robot.merged, robot.odometry, robot.keyframes, robot.keyframe_times, robot.truth].map(decode));
  apart(odometry);
  groups.paths.add(path(merged, robot.colour, 3, number));
  groups.before.add(path(odometry, robot.colour, 3, number));
  const dots = new Points(positions(keyframes), new PointsMaterial({ size: 6, sizeAttenuation: false, color: robot.colour }));
  dots.userData.robot = number;
  groups.keyframes.add(dots);
  pickable.push({ group: "keyframes", node: dots, xyz: keyframes,
    says: (i) => `${robot.name}, keyframe ${i} at ${times[i].toFixed(1)} s${robot.connected ? "" : " (not connected)"}` });
  pickable.push({ group: "before", node: groups.before.children.at(-1), xyz: odometry, says: () => `${robot.name}, by its own odometry` });
  if (truth?.length) {
    const line = path(truth, robot.colour, 2, number);
    line.userData.colour = "truth";
    groups.truth.add(line);
  }
}

function middles(ends) {
  const found = new Float32Array(ends.length / 2);
  for (let i = 0; i < found.length / 3; i++) for (let k = 0; k < 3; k++) found[3 * i + k] = (ends[6 * i + k] + ends[6 * i + 3 + k]) / 2;
  return found;
}

function addClosures(run, groups, pickable) {
  for (const decision of ["accepted", "rejected"]) {
    const rows = [...run.closures.keys()].filter((k) => (run.closures[k].decision === "rejected") === (decision === "rejected"));
    if (!rows.length) continue;
    const ends = new Float32Array(rows.flatMap((k) => run.closures[k].ends));
    const lines = segments(ends, decision, 2.5);
    groups[decision].add(lines);
    pickable.push({ group: decision, node: lines, xyz: middles(ends), says: (i) => closureName(run.closures[rows[i]]), closure: (i) => rows[i] });
  }
}

const closureName = (c) => `${name(c.query)} – ${name(c.match)}: ${c.decision}${c.reason ? `, ${c.reason}` : ""}`;

async function addRadio(run, groups, pickable) {
  for (const pair of run.radio ?? []) {
    const [ends, times, range] = await Promise.all([decode(pair.ends), decode(pair.times), decode(pair.range)]);
    if (!ends?.length) continue;
    const lines = segments(ends, "radio", 1);
    groups.radio.add(lines);
    pickable.push({ group: "radio", node: lines, xyz: middles(ends),
      says: (i) => `${pair.a} and ${pair.b} at ${times[i].toFixed(1)} s: ${Number.isNaN(range[i]) ? "direction only" : `${figure(range[i])} m measured`}` });
  }
}

// What a picture is to hold: all points of a layer, and of the map all but stragglers.
function extentOf(pickable, layer, mapXyz) {
  const own = pickable.filter(({ group }) => group === layer).flatMap(({ xyz }) => vectors(xyz, 1));
  const points = own.concat(mapXyz ? withoutStragglers(vectors(mapXyz, Math.ceil(mapXyz.length / 15000))) : []);
  const box = new Box3().setFromPoints(points.length ? points : [new Vector3()]);
  return { points, center: box.getCenter(new Vector3()), radius: Math.max(5, box.getSize(new Vector3()).length() / 2) };
}

const vectors = (xyz, every) => Array.from({ length: Math.floor(xyz.length / 3 / every) }, (_, i) => new Vector3().fromArray(xyz, 3 * every * i));

function withoutStragglers(points) {
  const at = (axis) => points.map((point) => point[axis]).sort((a, b) => a - b);
  const between = ["x", "y", "z"].map((axis) => [axis, ...[0.02, 0.98].map((q) => at(axis)[Math.floor(q * (points.length - 1))])]);
  return points.filter((point) => between.every(([axis, low, high]) => point[axis] >= low && point[axis] <= high));
}

// Where to look, and from how far, so that all fills the picture: it is moved to the middle, which changes how far.
function framed({ points, center, radius }, direction, camera) {
  const toward = direction.clone().normalize(), right = new Vector3().crossVectors(camera.up, toward).normalize(), up = new Vector3().crossVectors(toward, right);
  const tangent = Math.tan((camera.fov * Math.PI) / 360), target = center.clone();
  let far = 0;
  for (let step = 0; step < 3; step++) {
    const seen = points.map((point) => point.clone().sub(target)).map((from) => [from.dot(right), from.dot(up), from.dot(toward)]);
    far = seen.reduce((most, [u, v, w]) => Math.max(most, w + Math.max(Math.abs(u) / camera.aspect, Math.abs(v)) / tangent), radius / 5);
    const middle = [0, 1].map((axis) => {
      const angles = seen.map((of) => of[axis] / Math.max(far - of[2], far / 100));
      return (far * (angles.reduce((a, b) => Math.max(a, b), -Infinity) + angles.reduce((a, b) => Math.min(a, b), Infinity))) / 2;
    });
    if (step < 2 && points.length) target.addScaledVector(right, middle[0]).addScaledVector(up, middle[1]);
  }
  return { target, far: 1.06 * far };
}
