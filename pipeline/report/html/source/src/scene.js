// The merged map in 3-D: points, trajectories, keyframes, closures, radio links.  Drawn when something changes only.
import {
  BufferAttribute, BufferGeometry, Color, ColorManagement, Group, Line, LineBasicMaterial, LinearSRGBColorSpace, LineSegments,
  PerspectiveCamera, Points, PointsMaterial, Scene, Sphere, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { decode } from "./decode.js";
import { el, figure, palette, toggles } from "./dom.js";

const PICK_PIXELS = 14;
ColorManagement.enabled = false; // colours as the page has them, no lighting

export async function scene3d(run, { onClosure }) {
  const canvas = el("canvas", {
    tabindex: "0",
    role: "img",
    "aria-label": `Merged map in 3-D: ${run.robots.map((r) => r.name).join(", ")}. Arrow keys turn it, plus and minus zoom.`,
  });
  const hint = el("output", { class: "hint", "aria-live": "polite" });
  const frame = el("div", { class: "scene" }, canvas, hint);
  let renderer;
  try {
    renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
  } catch {
    return el("p", { class: "note" }, "This browser draws no WebGL; the pictures beside the report show the same from above.");
  }
  renderer.outputColorSpace = LinearSRGBColorSpace;
  const scene = new Scene();
  const camera = new PerspectiveCamera(50, 1, 0.1, 1e5);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, canvas);
  controls.enableDamping = false;
  controls.zoomToCursor = true;

  const groups = Object.fromEntries(
    ["map", "paths", "keyframes", "accepted", "rejected", "radio", "truth", "before"].map((name) => [name, new Group()]),
  );
  for (const group of Object.values(groups)) scene.add(group);
  groups.rejected.visible = groups.radio.visible = groups.truth.visible = groups.before.visible = false;

  const pickable = [];
  const map = await mapPoints(run.map);
  if (map) groups.map.add(map.points);
  for (const robot of run.robots) await addRobot(robot, groups, pickable);
  await addClosures(run, groups, pickable);
  await addRadio(run, groups, pickable);

  const bounds = sphereOf(run, map, pickable);
  let asked = false;
  const draw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      renderer.render(scene, camera);
      frame.dataset.drawn = String(Number(frame.dataset.drawn ?? 0) + 1);
    });
  };
  const look = (direction) => {
    controls.target.copy(bounds.center);
    camera.position.copy(bounds.center).addScaledVector(direction.normalize(), 2.0 * bounds.radius);
    camera.near = bounds.radius / 500;
    camera.far = bounds.radius * 50;
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
    draw();
  };
  const recolour = () => {
    const colour = palette();
    scene.background = new Color(colour("canvas"));
    for (const group of [groups.accepted, groups.rejected, groups.radio, groups.truth])
      for (const line of group.children) line.material.color.set(colour(line.userData.colour));
    draw();
  };
  controls.addEventListener("change", draw);
  new ResizeObserver(resize).observe(frame);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  document.addEventListener("themechange", recolour);
  document.addEventListener("visibilitychange", draw);
  recolour();
  look(new Vector3(-0.4, -0.8, 1));

  const nearest = (event) => nearestOf(pickable, groups, event, canvas, camera);
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons) return;
    const found = nearest(event);
    hint.textContent = found ? found.says : "";
    canvas.style.cursor = found?.closure === undefined ? "grab" : "pointer";
  });
  canvas.addEventListener("click", (event) => {
    const found = nearest(event);
    hint.textContent = found ? found.says : "";
    if (found?.closure !== undefined) onClosure(found.closure);
  });
  canvas.addEventListener("keydown", (event) => {
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    const offset = camera.position.clone().sub(controls.target);
    if (turn) {
      const flat = Math.hypot(offset.x, offset.y), azimuth = Math.atan2(offset.y, offset.x) + turn[0];
      const height = Math.min(1.5, Math.max(-1.5, Math.atan2(offset.z, flat) - turn[1])), far = offset.length();
      offset.set(far * Math.cos(height) * Math.cos(azimuth), far * Math.cos(height) * Math.sin(azimuth), far * Math.sin(height));
    } else if (event.key === "+" || event.key === "=") offset.multiplyScalar(0.85);
    else if (event.key === "-") offset.multiplyScalar(1 / 0.85);
    else return;
    event.preventDefault();
    camera.position.copy(controls.target).add(offset);
    controls.update();
    draw();
  });

  const show = (name) => (on) => {
    groups[name].visible = on;
    draw();
  };
  const count = (name) => groups[name].children.length > 0;
  const layers = [
    count("map") && { label: "map", checked: true, change: show("map") },
    { label: "trajectories", checked: true, change: show("paths") },
    { label: "keyframes", checked: true, change: show("keyframes") },
    count("accepted") && { label: "accepted closures", swatch: "var(--accepted)", checked: true, change: show("accepted") },
    count("rejected") && { label: "rejected closures", swatch: "var(--rejected)", change: show("rejected") },
    count("radio") && { label: "radio links", swatch: "var(--radio)", change: show("radio") },
    count("truth") && { label: "ground truth", swatch: "var(--truth)", change: show("truth") },
  ].filter(Boolean);
  const when = [
    { label: "after merging", checked: true, value: "after" },
    { label: "before: each robot in its own frame", value: "before" },
  ].map((option) => ({
    ...option,
    change: (_, value) => {
      const before = value === "before";
      groups.before.visible = before;
      for (const name of ["paths", "keyframes"]) groups[name].visible = !before;
      const checks = controlsBar.querySelectorAll("input[type=checkbox]");
      layers.forEach((layer, k) => {
        checks[k].disabled = before;
        layer.change(!before && checks[k].checked);
      });
      draw();
    },
  }));
  const colours = map
    ? Object.keys(map.colour).map((name, k) => ({ label: name, value: name, checked: k === 0, change: (_, by) => (map.colour[by](), draw()) }))
    : [];
  const controlsBar = el(
    "div",
    { class: "controls" },
    toggles("Show", layers),
    toggles("When", when, { type: "radio", name: `when-${run.id}` }),
    colours.length > 1 ? toggles("Colour by", colours, { type: "radio", name: `colour-${run.id}` }) : null,
    el(
      "div",
      { class: "buttons" },
      el("button", { type: "button", onclick: () => look(new Vector3(0, -0.001, 1)) }, "from above"),
      el("button", { type: "button", onclick: () => look(new Vector3(-0.4, -0.8, 1)) }, "slanted"),
    ),
  );
  return el("div", {}, controlsBar, frame);
}

async function mapPoints(map) {
  if (!map) return null;
  const [xyz, robot, intensity] = await Promise.all([decode(map.xyz), decode(map.robot), decode(map.intensity)]);
  const n = xyz.length / 3;
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(xyz, 3, true));
  const colours = new BufferAttribute(new Uint8Array(3 * n), 3, true);
  geometry.setAttribute("color", colours);
  geometry.boundingSphere = new Sphere(new Vector3(0.5, 0.5, 0.5), 0.87);
  const paint = (rgb) => {
    for (let i = 0; i < n; i++) rgb(i, colours.array, 3 * i);
    colours.needsUpdate = true;
  };
  const ramp = (share, out, at) => {
    // from blue over teal to yellow: ordered in lightness too
    const s = Math.min(1, Math.max(0, share));
    out[at] = 255 * Math.min(1, Math.max(0, 2.2 * s - 0.9));
    out[at + 1] = 255 * (0.25 + 0.65 * s);
    out[at + 2] = 255 * Math.max(0.1, 0.75 - 0.65 * s);
  };
  const rgb = map.colours.map((hex) => {
    const value = parseInt(hex.slice(1), 16);
    return [value >> 16, (value >> 8) & 255, value & 255];
  });
  const colour = {
    robot: () => paint((i, out, at) => out.set(rgb[robot[i]], at)),
    height: () => paint((i, out, at) => ramp((xyz[3 * i + 2] / 65535 - map.heights[0]) / (map.heights[1] - map.heights[0]), out, at)),
  };
  if (intensity) colour.intensity = () => paint((i, out, at) => ramp(intensity[i] / 255, out, at));
  colour.robot();
  const points = new Points(geometry, new PointsMaterial({ size: 1.4, sizeAttenuation: false, vertexColors: true }));
  points.scale.set(...map.extent.map((m) => Math.max(m, 1e-6)));
  points.position.set(...map.min);
  return { points, colour };
}

const positions = (array) => new BufferGeometry().setAttribute("position", new BufferAttribute(array, 3));

async function addRobot(robot, groups, pickable) {
  const [merged, odometry, keyframes, times, truth] = await Promise.all(
    [robot.merged, robot.odometry, robot.keyframes, robot.keyframe_times, robot.truth].map(decode),
  );
  if (merged) groups.paths.add(new Line(positions(merged), new LineBasicMaterial({ color: robot.colour })));
  if (odometry) groups.before.add(new Line(positions(odometry), new LineBasicMaterial({ color: robot.colour })));
  if (keyframes) {
    groups.keyframes.add(new Points(positions(keyframes), new PointsMaterial({ size: 4, sizeAttenuation: false, color: robot.colour })));
    pickable.push({
      group: "keyframes",
      xyz: keyframes,
      says: (i) => `${robot.name}, keyframe ${i}, ${figure(times[i], 6)} s${robot.connected ? "" : " (not connected)"}`,
    });
  }
  if (truth) {
    const line = new Line(positions(truth), new LineBasicMaterial());
    line.userData.colour = "truth";
    groups.truth.add(line);
  }
}

async function addClosures(run, groups, pickable) {
  for (const name of ["accepted", "rejected"]) {
    const rows = run.closures.map((c, k) => k).filter((k) => (run.closures[k].decision === "accepted") === (name === "accepted"));
    const drawn = rows.filter((k) => run.closures[k].ends);
    if (!drawn.length) continue;
    const xyz = new Float32Array(drawn.flatMap((k) => run.closures[k].ends));
    const lines = new LineSegments(positions(xyz), new LineBasicMaterial());
    lines.userData.colour = name;
    groups[name].add(lines);
    const middles = new Float32Array(3 * drawn.length);
    for (let i = 0; i < drawn.length; i++)
      for (let k = 0; k < 3; k++) middles[3 * i + k] = (xyz[6 * i + k] + xyz[6 * i + 3 + k]) / 2;
    pickable.push({ group: name, xyz: middles, says: (i) => closureName(run.closures[drawn[i]]), closure: (i) => drawn[i] });
  }
}

export const closureName = (c) => `${c.query.join(" ")} – ${c.match.join(" ")}: ${c.decision}${c.reason ? `, ${c.reason}` : ""}`;

async function addRadio(run, groups, pickable) {
  for (const pair of run.radio ?? []) {
    const ends = await decode(pair.ends);
    if (!ends?.length) continue;
    const lines = new LineSegments(positions(ends), new LineBasicMaterial({ transparent: true, opacity: 0.6 }));
    lines.userData.colour = "radio";
    groups.radio.add(lines);
    const [times, ranges] = await Promise.all([decode(pair.times), decode(pair.range)]);
    const middles = new Float32Array(ends.length / 2);
    for (let i = 0; i < middles.length / 3; i++)
      for (let k = 0; k < 3; k++) middles[3 * i + k] = (ends[6 * i + k] + ends[6 * i + 3 + k]) / 2;
    pickable.push({
      group: "radio",
      xyz: middles,
      says: (i) => `${pair.a} and ${pair.b} at ${figure(times[i], 6)} s: ${Number.isNaN(ranges[i]) ? "no range" : `${figure(ranges[i])} m measured`}`,
    });
  }
}

function sphereOf(run, map, pickable) {
  const sphere = new Sphere();
  const points = [];
  for (const { group, xyz } of pickable) if (group === "keyframes") for (let i = 0; i < xyz.length; i += 3) points.push(new Vector3(xyz[i], xyz[i + 1], xyz[i + 2]));
  if (!points.length && map) points.push(map.points.position.clone(), map.points.position.clone().add(map.points.scale));
  if (!points.length) points.push(new Vector3(), new Vector3(1, 1, 1));
  sphere.setFromPoints(points);
  sphere.radius = Math.max(sphere.radius, 5);
  return sphere;
}

function nearestOf(pickable, groups, event, canvas, camera) {
  const box = canvas.getBoundingClientRect();
  const x = event.clientX - box.left, y = event.clientY - box.top;
  const m = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).elements;
  let best = null, least = PICK_PIXELS ** 2;
  for (const set of pickable) {
    if (!groups[set.group].visible) continue;
    const p = set.xyz, favour = set.closure ? 0.5 : 1;
    for (let i = 0; i < p.length; i += 3) {
      const w = m[3] * p[i] + m[7] * p[i + 1] + m[11] * p[i + 2] + m[15];
      if (w <= 0) continue;
      const u = ((m[0] * p[i] + m[4] * p[i + 1] + m[8] * p[i + 2] + m[12]) / w + 1) * 0.5 * box.width - x;
      const v = (1 - (m[1] * p[i] + m[5] * p[i + 1] + m[9] * p[i + 2] + m[13]) / w) * 0.5 * box.height - y;
      const apart = favour * (u * u + v * v);
      if (apart < least) [least, best] = [apart, [set, i / 3]];
    }
  }
  if (!best) return null;
  const [set, i] = best;
  return { says: set.says(i), closure: set.closure?.(i) };
}
