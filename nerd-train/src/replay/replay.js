// The painter of pictures in three dimensions. `replay(root, data)` puts a canvas with its controls into the element `root`; `data` is what
// `nerd_train::replay::Replay` serialises. The first track is solid, the others are ghosts behind it.
"use strict";
const replay = (() => {
  // Vectors, and quaternions x y z w.
  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const times = (a, k) => [a[0] * k, a[1] * k, a[2] * k];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = a => times(a, 1 / Math.hypot(...a));
  const place = (pose, x) => {
    const u = pose.slice(3, 6), t = times(cross(u, x), 2);
    return add(add(pose, x), add(times(t, pose[6]), cross(u, t)));
  };
  const middle = poses => times(poses.reduce((sum, p) => add(sum, p), [0, 0, 0]), 1 / poses.length);

  const trace = (context, seen) => {
    context.beginPath();
    seen.forEach((p, k) => k ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1]));
  };

  // Faces of a shape in its own frame; round ones have `n` sides and stand along z.
  function faces(shape) {
    const size = shape.size, out = [];
    if (shape.kind === "box") {
      const corner = (x, y, z) => [x * size[0], y * size[1], z * size[2]];
      for (const s of [-1, 1]) {
        out.push([corner(s, -1, -1), corner(s, s, -s), corner(s, 1, 1), corner(s, -s, s)]);
        out.push([corner(-1, s, -1), corner(-s, s, s), corner(1, s, 1), corner(s, s, -s)]);
        out.push([corner(-1, -1, s), corner(s, -s, s), corner(1, 1, s), corner(-s, s, s)]);
      }
      return out;
    }
    const n = 14, [radius, half] = size, rings = [];
    if (shape.kind === "cylinder") {
      rings.push([0, -half], [radius, -half], [radius, half], [0, half]);
    } else {
      for (let k = 0; k <= 8; k++) {
        const a = Math.PI * (k / 8 - 0.5);
        rings.push([radius * Math.cos(a), radius * Math.sin(a) + (k < 4 ? -half : half)]);
        if (k === 4 && half > 0) rings.splice(rings.length - 1, 0, [radius, -half]);
      }
    }
    const at = (ring, i) => [ring[0] * Math.cos(2 * Math.PI * i / n), ring[0] * Math.sin(2 * Math.PI * i / n), ring[1]];
    for (let k = 0; k + 1 < rings.length; k++)
      for (let i = 0; i < n; i++)
        out.push([at(rings[k], i), at(rings[k], i + 1), at(rings[k + 1], i + 1), at(rings[k + 1], i)]);
    return out;
  }

  // A function that paints a frame of `data` into a canvas, seen from `view`.
  function painter(data) {
    const solids = data.shapes.map(shape => ({
      ...shape,
      // Of what is round and long, and seen too thin for faces.
      ends: shape.kind === "capsule" && [-1, 1].map(s => place(shape.pose, [0, 0, s * shape.size[1]])),
      faces: faces(shape).map(face => face.map(x => place(shape.pose, x))),
    }));

    // A camera that turns about the robot. East and north span the ground.
    const up = data.up, east = Math.abs(up[0]) > 0.9 ? [0, 1, 0] : [1, 0, 0], north = cross(up, east);
    const first = data.tracks[0].poses[0];
    const size = link => Math.max(0, ...data.shapes.filter(s => s.link === link).flatMap(s => s.size));
    const reach = Math.max(0.05, ...first.map((p, link) => Math.hypot(...sub(p, middle(first))) + size(link)));
    const light = unit(add(add(up, times(east, 0.4)), times(north, -0.5)));
    const at = (track, frame) => track.poses[Math.min(frame, track.poses.length - 1)];

    const camera = (canvas, frame, { turn, lift, distance }) => {
      const target = middle(at(data.tracks[0], frame));
      const flat = add(times(east, Math.sin(turn)), times(north, -Math.cos(turn)));
      const back = add(times(flat, Math.cos(lift)), times(up, Math.sin(lift)));
      const right = unit(cross(up, back)), above = cross(back, right), eye = add(target, times(back, distance));
      const focus = 1.1 * Math.min(canvas.width, canvas.height);
      const see = x => {
        const r = sub(x, eye), depth = -dot(r, back);
        return [canvas.width / 2 + focus * dot(r, right) / depth, canvas.height / 2 - focus * dot(r, above) / depth, depth];
      };
      return { target, eye, back, right, above, focus, see };
    };

    const paint = (canvas, frame, view, scale = 1) => {
      const context = canvas.getContext("2d"), near = 0.05;
      const { target, eye, focus, see } = camera(canvas, frame, view);
      const stroke = (a, b) => {
        const seen = [see(a), see(b)];
        if (seen.every(p => p[2] > near)) { trace(context, seen); context.stroke(); }
      };
      context.fillStyle = "#f4f5f7";
      context.fillRect(0, 0, canvas.width, canvas.height);
      // A grid of metres on every plane, around the robot, so that travel is seen.
      context.strokeStyle = "#c9ced6";
      context.lineWidth = scale;
      for (const [normal, offset] of data.planes) {
        const a = unit(cross(Math.abs(dot(normal, north)) > 0.9 ? east : north, normal)), b = cross(normal, a), reach = 6;
        const origin = times(normal, offset), a0 = Math.round(dot(sub(target, origin), a)), b0 = Math.round(dot(sub(target, origin), b));
        const point = (i, j) => add(origin, add(times(a, a0 + i), times(b, b0 + j)));
        for (let k = -reach; k <= reach; k++)
          for (let j = -reach; j < reach; j++) {
            stroke(point(k, j), point(k, j + 1));
            stroke(point(j, k), point(j + 1, k));
          }
      }
      // Of ground that is not flat, the lines between its nodes.
      if (data.ground) {
        const { cell, nodes: [n, m], heights, origin, axes: [a, b, c] } = data.ground, reach = Math.min(30, Math.ceil(4 / cell));
        const [i0, j0] = [a, b].map(axis => Math.round(dot(sub(target, origin), axis) / cell)), around = (k, n) => ((k % n) + n) % n;
        const node = (i, j) => {
          const high = heights[around(i0 + i, n) * m + around(j0 + j, m)];
          return add(origin, add(add(times(a, (i0 + i) * cell), times(b, (j0 + j) * cell)), times(c, high)));
        };
        for (let k = -reach; k <= reach; k++)
          for (let j = -reach; j < reach; j++) {
            stroke(node(k, j), node(k, j + 1));
            stroke(node(j, k), node(j + 1, k));
          }
      }
      const polygons = [], shadows = [];
      const falls = data.planes.slice(0, 1).map(([n, offset]) => x => sub(x, times(up, (dot(x, n) - offset) / dot(up, n))));
      data.tracks.forEach((track, k) => {
        const poses = at(track, frame);
        for (const solid of solids) {
          // What stands in the scene is drawn once.
          const still = solid.link === null, at = x => still ? x : place(poses[solid.link], x);
          if (still && k) continue;
          // A ghost stands back a little, so that where both agree the first is seen.
          const far = x => Math.hypot(...sub(x, eye)) + 0.02 * k, centre = at(solid.pose.slice(0, 3));
          const wide = 2 * solid.size[0] * focus / far(centre);
          if (solid.ends && wide < 4 * scale) {
            const world = solid.ends.map(at), seen = world.map(see);
            const colour = k ? `hsla(${solid.hue} 10% 40% / 0.5)` : `hsl(${solid.hue} 75% 45%)`;
            if (k === 0) for (const fall of falls) shadows.push(world.map(fall).map(see));
            if (seen.every(p => p[2] > near)) polygons.push([far(centre), colour, seen, Math.max(wide, 2 * scale)]);
            continue;
          }
          for (const face of solid.faces) {
            const world = face.map(at);
            const across = cross(sub(world[2], world[0]), sub(world[3], world[1])), length = Math.hypot(...across);
            if (length < 1e-12) continue;
            const normal = times(across, 1 / length), centre = times(add(add(world[0], world[1]), add(world[2], world[3])), 0.25);
            if (k === 0 && dot(normal, up) > 0)
              for (const fall of falls) if (dot(sub(centre, fall(centre)), up) > 0) shadows.push(world.map(fall).map(see));
            if (dot(normal, sub(eye, centre)) < 0) continue;
            const seen = world.map(see);
            if (seen.some(p => p[2] < near)) continue;
            const shade = 34 + 40 * Math.max(0, dot(normal, light));
            const colour = k ? `hsla(${solid.hue} 10% ${shade}% / 0.35)` : `hsl(${solid.hue} ${still ? 8 : 45}% ${shade + 15 * still}%)`;
            // What lies on a face of the scene is painted after it.
            polygons.push([still ? Math.max(...world.map(far)) : far(centre), colour, seen, 0.7]);
          }
        }
        const rod = (from, to) => {
          const seen = [from, to].map(see), colour = k ? "rgba(125,133,144,0.35)" : "#7d8590";
          const depth = Math.hypot(...sub(times(add(from, to), 0.5), eye));
          if (seen.every(p => p[2] > near)) polygons.push([depth, colour, seen, 0.03 * focus / seen[0][2]]);
        };
        for (const [a, b] of data.rods) rod(poses[a].slice(0, 3), poses[b].slice(0, 3));
        for (const { link, pose } of data.rods.length ? data.shapes.filter(s => s.link !== null) : [])
          rod(poses[link].slice(0, 3), place(poses[link], pose.slice(0, 3)));
      });
      context.fillStyle = context.strokeStyle = "#dfe2e7";
      context.lineCap = "round";
      context.lineWidth = 2 * scale;
      for (const seen of shadows) if (seen.every(p => p[2] > near)) { trace(context, seen); seen.length === 2 ? context.stroke() : context.fill(); }
      polygons.sort((a, b) => b[0] - a[0]);
      for (const [, colour, seen, width] of polygons) {
        context.fillStyle = context.strokeStyle = colour;
        context.lineWidth = width;
        trace(context, seen);
        if (seen.length > 2) { context.closePath(); context.fill(); }
        context.stroke();
      }
      const goal = data.goals[frame] || [];
      if (goal.length >= 3) {
        const p = see(goal);
        context.fillStyle = "#d0021b";
        context.beginPath(); context.arc(p[0], p[1], Math.max(3, 0.02 * focus / p[2]), 0, 7); context.fill();
      }
    };
    return { paint, camera, place, view: { turn: -0.6, lift: 0.35, distance: 3 * reach + 0.2 } };
  }

  const replay = (root, data) => {
    root.innerHTML = `<div class="replay"><canvas tabindex="0" aria-label="replay"></canvas><div class="controls">
      <button type="button">Pause</button><input type="range" min="0" value="0" aria-label="frame">
      <select aria-label="speed"><option value="0.25">x 0.25</option><option value="0.5">x 0.5</option>
      <option value="1" selected>x 1</option><option value="2">x 2</option></select><output></output></div>
      <div class="legend"></div></div>`;
    const canvas = root.querySelector("canvas");
    const [button, time, speed, output] = ["button", "input", "select", "output"].map(name => root.querySelector(name));
    const frames = data.tracks[0].poses.length;
    const most = data.apart.reduce((a, b) => Math.max(a, b), 1e-6);
    time.max = frames - 1;
    root.querySelector(".legend").textContent =
      data.tracks.map((track, k) => (k ? "ghost: " : "solid: ") + track.name).join("; ") + ". Drag to turn, wheel to zoom, space to pause." +
      (data.apart.length ? ` Curve: mean distance of contact points, ${(1e3 * most).toFixed(1)} mm at most.` : "");
    const { paint, view } = painter(data);
    let frame = 0, playing = true, last = 0;

    function draw() {
      const scale = window.devicePixelRatio || 1, context = canvas.getContext("2d");
      canvas.width = canvas.clientWidth * scale;
      canvas.height = canvas.clientHeight * scale;
      paint(canvas, frame, view, scale);
      // How far apart the motions are, over time, up to now in full.
      const reached = data.apart.map((x, k) => [canvas.width * k / frames, canvas.height * (0.98 - 0.13 * x / most)]);
      for (const [colour, upto] of [["#e3b59c", frames], ["#b8450f", frame + 1]]) {
        context.strokeStyle = colour;
        context.lineWidth = 1.5 * scale;
        trace(context, reached.slice(0, upto));
        context.stroke();
      }
      time.value = frame;
      // How often it was painted, for whoever tests that it moves.
      canvas.dataset.painted = +(canvas.dataset.painted || 0) + 1;
      const reward = data.rewards[frame], apart = data.apart[frame];
      output.textContent = `${(frame * data.dt).toFixed(2)} s` + (reward === undefined ? "" : `, reward ${reward.toFixed(1)}`) +
        (apart === undefined ? "" : `, ${(1e3 * apart).toFixed(1)} mm apart`);
    }

    function tick(now) {
      const pause = 1000 * data.dt / +speed.value;
      // Off the screen nothing is painted; a slow machine skips frames, so that time stays true.
      if (playing && now - last >= pause && canvas.offsetParent !== null) {
        frame = (frame + Math.min(8, Math.max(1, Math.round((now - last) / pause)))) % frames;
        last = now;
        const box = canvas.getBoundingClientRect();
        if (box.bottom > 0 && box.top < window.innerHeight) draw();
      }
      requestAnimationFrame(tick);
    }
    const toggle = () => { playing = !playing; button.textContent = playing ? "Pause" : "Play"; };
    button.onclick = toggle;
    canvas.onkeydown = e => { if (e.key === " ") { e.preventDefault(); toggle(); } };
    time.oninput = () => { frame = +time.value; if (playing) toggle(); draw(); };
    let held = null;
    canvas.onpointerdown = e => { held = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); };
    canvas.onpointerup = () => { held = null; };
    canvas.onpointermove = e => {
      if (!held) return;
      view.turn += (held[0] - e.clientX) * 0.008;
      view.lift = Math.min(1.5, Math.max(-0.2, view.lift + (e.clientY - held[1]) * 0.006));
      held = [e.clientX, e.clientY];
      draw();
    };
    canvas.onwheel = e => { e.preventDefault(); view.distance *= Math.exp(e.deltaY * 0.001); draw(); };
    window.addEventListener("resize", draw);
    draw();
    requestAnimationFrame(tick);
  };
  replay.painter = painter;
  return replay;
})();
