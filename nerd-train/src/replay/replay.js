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
  const norm = a => Math.sqrt(dot(a, a));
  const unit = a => times(a, 1 / norm(a));
  const place = (pose, x) => {
    const u = pose.slice(3, 6), t = times(cross(u, x), 2);
    return add(add(pose, x), add(times(t, pose[6]), cross(u, t)));
  };
  const middle = poses => times(poses.reduce((sum, p) => add(sum, p), [0, 0, 0]), 1 / poses.length);

  // A pixel of this hue (degrees).
  const colour = (hue, light) => [0, 8, 4].reduce((sum, n, k) => {
    const turn = (n + hue / 30) % 12, part = light - 0.45 * Math.min(light, 1 - light) * Math.max(-1, Math.min(turn - 3, 9 - turn, 1));
    return sum + Math.round(255 * part) * 256 ** k;
  }, 255 * 256 ** 3);

  const trace = (context, seen) => {
    seen.forEach((p, k) => k ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1]));
  };

  // Corners of a shape in its own frame, and faces by their numbers, seen from outside against the clock; round ones have `n` sides and stand
  // along z.
  function body({ kind, size, hull }) {
    if (hull) return hull;
    if (kind === "box") {
      const corners = Array.from({ length: 8 }, (_, k) => size.map((half, axis) => k >> axis & 1 ? half : -half));
      return [corners, [[1, 3, 7, 5], [0, 4, 6, 2], [2, 6, 7, 3], [0, 1, 5, 4], [4, 5, 7, 6], [0, 2, 3, 1]]];
    }
    const n = 12, [radius, half] = size, rings = [];
    if (kind === "cylinder") {
      rings.push([0, -half], [radius, -half], [radius, half], [0, half]);
    } else {
      for (let k = 0; k <= 6; k++) {
        const a = Math.PI * (k / 6 - 0.5);
        rings.push([radius * Math.cos(a), radius * Math.sin(a) + (k < 3 ? -half : half)]);
        if (k === 3 && half > 0) rings.splice(rings.length - 1, 0, [radius, -half]);
      }
    }
    const around = Array.from({ length: n }, (_, i) => [Math.cos(2 * Math.PI * i / n), Math.sin(2 * Math.PI * i / n)]);
    const corners = rings.flatMap(([r, z]) => around.map(([x, y]) => [r * x, r * y, z]));
    const face = (_, k) => { const i = k - k % n, next = i + (k + 1) % n; return [k, next, next + n, k + n]; };
    return [corners, Array.from({ length: n * (rings.length - 1) }, face)];
  }

  // A function that paints a frame of `data` into a canvas, seen from `view`.
  function painter(data) {
    const solids = data.shapes.map(shape => ({
      ...shape,
      // Of what is round and long, and seen too thin for faces.
      ends: shape.kind === "capsule" && [-1, 1].map(s => place(shape.pose, [0, 0, s * shape.size[1]])),
      corners: body(shape)[0].map(x => place(shape.pose, x)),
      faces: body(shape)[1],
    }));

    // A camera that turns about the robot. East and north span the ground.
    const up = data.up, east = Math.abs(up[0]) > 0.9 ? [0, 1, 0] : [1, 0, 0], north = cross(up, east);
    const first = data.tracks[0].poses[0];
    const size = link => Math.max(0, ...data.shapes.filter(s => s.link === link).flatMap(s => s.size));
    const reach = Math.max(0.05, ...first.map((p, link) => norm(sub(p, middle(first))) + size(link)));
    const light = unit(add(add(up, times(east, 0.4)), times(north, -0.5)));
    // Two axes along a plane.
    const axes = normal => { const a = unit(cross(Math.abs(dot(normal, north)) > 0.9 ? east : north, normal)); return [a, cross(normal, a)]; };
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

    // Other environments around the first, each in a cell of its own and each link a line; `ends` is `[env][stick][end][x, y, z]`. They are too
    // many for paths: pixels are set here, the nearest last.
    const sheet = document.createElement("canvas");
    let away = [], image = null, near = null;
    const crowd = (context, { eye, back, right, above, focus }, { sticks, ends }) => {
      const each = 6 * sticks.length, n = ends.length / each, { width, height } = context.canvas;
      if (away.length !== n) {
        const half = Math.ceil((Math.sqrt(n + 1) - 1) / 2), side = 2 * half + 1, [a, b] = axes(data.planes[0]?.[0] || up);
        const cells = Array.from({ length: side * side }, (_, k) => [k % side - half, Math.floor(k / side) - half]);
        away = cells.sort((a, b) => Math.hypot(...a) - Math.hypot(...b)).slice(1, n + 1)
          .map(([i, j]) => add(times(a, 2.2 * reach * i), times(b, 2.2 * reach * j)));
      }
      if (sheet.width !== width || sheet.height !== height || !image) {
        [sheet.width, sheet.height] = [width, height];
        image = new ImageData(width, height);
        near = new Float32Array(width * height);
      }
      const pixels = new Uint32Array(image.data.buffer), shades = sticks.map(({ hue }) => [0.6, 0.5, 0.36].map(light => colour(hue, light)));
      pixels.fill(0);
      near.fill(Infinity);
      for (let env = 0, at = 0; env < n; env++) {
        const [x0, y0, z0] = sub(away[env], eye);
        for (let s = 0; s < sticks.length; s++, at += 6) {
          const seen = [];
          for (const end of [at, at + 3]) {
            const x = ends[end] + x0, y = ends[end + 1] + y0, z = ends[end + 2] + z0;
            const depth = -(x * back[0] + y * back[1] + z * back[2]);
            seen.push(width / 2 + focus * (x * right[0] + y * right[1] + z * right[2]) / depth);
            seen.push(height / 2 - focus * (x * above[0] + y * above[1] + z * above[2]) / depth, depth);
          }
          const [u0, v0, d0, u1, v1, d1] = seen, thick = Math.max(1, Math.round(sticks[s].width * focus / d0)), length = Math.hypot(u1 - u0, v1 - v0);
          if (!(d0 > 0.1 && d1 > 0.1) || length > width) continue;
          // Half its thickness beyond either end, column by column, or row by row.
          const [du, dv] = length > 1e-3 ? [(u1 - u0) / length, (v1 - v0) / length] : [1, 0], steep = Math.abs(dv) > Math.abs(du);
          const steps = Math.ceil((length + thick) * Math.max(Math.abs(du), Math.abs(dv)));
          for (let k = 0; k <= steps; k++) {
            const part = (length + thick) * k / Math.max(1, steps) - thick / 2, depth = d0 + (d1 - d0) * part / Math.max(length, 1e-3);
            const u = Math.round(u0 + du * part), v = Math.round(v0 + dv * part);
            for (let j = 0; j < thick; j++) {
              const across = j - (thick >> 1), x = steep ? u + across : u, y = steep ? v : v + across, i = y * width + x;
              if (x < 0 || y < 0 || x >= width || y >= height || depth >= near[i]) continue;
              near[i] = depth;
              pixels[i] = shades[s][Math.floor(3 * j / thick)];
            }
          }
        }
      }
      sheet.getContext("2d").putImageData(image, 0, 0);
      context.drawImage(sheet, 0, 0);
    };

    const paint = (canvas, frame, view, scale = 1, others = null) => {
      const context = canvas.getContext("2d"), near = 0.05;
      const looks = camera(canvas, frame, view), { target, eye, focus, see } = looks;
      const stroke = (a, b) => {
        const seen = [see(a), see(b)];
        if (seen.every(p => p[2] > near)) trace(context, seen);
      };
      context.fillStyle = "#f4f5f7";
      context.fillRect(0, 0, canvas.width, canvas.height);
      // A grid of metres on every plane, around the robot, so that travel is seen.
      context.strokeStyle = "#c9ced6";
      context.lineWidth = scale;
      context.beginPath();
      for (const [normal, offset] of data.planes) {
        const [a, b] = axes(normal), reach = 6;
        const origin = times(normal, offset), a0 = Math.round(dot(sub(target, origin), a)), b0 = Math.round(dot(sub(target, origin), b));
        const point = (i, j) => add(origin, add(times(a, a0 + i), times(b, b0 + j)));
        for (let k = -reach; k <= reach; k++)
          for (let j = -reach; j < reach; j++) {
            stroke(point(k, j), point(k, j + 1));
            stroke(point(j, k), point(j + 1, k));
          }
      }
      // Of ground that is not flat, the lines between its nodes.
      for (const { cell, repeats, nodes, heights, origin, axes: [a, b, c] } of data.grounds) {
        const around = (k, n) => ((k % n) + n) % n, high = (i, j) => heights[around(i, nodes[0]) * nodes[1] + around(j, nodes[1])];
        const node = (i, j) => add(origin, add(add(times(a, i * cell[0]), times(b, j * cell[1])), times(c, high(i, j))));
        // From and to which nodes.
        const [[i0, i1], [j0, j1]] = [a, b].map((axis, k) => {
          const reach = Math.min(30, Math.ceil(4 / cell[k])), middle = Math.round(dot(sub(target, origin), axis) / cell[k]);
          return repeats ? [middle - reach, middle + reach] : [Math.max(0, middle - reach), Math.min(nodes[k] - 1, middle + reach)];
        });
        for (let i = i0; i <= i1; i++)
          for (let j = j0; j <= j1; j++) {
            if (j < j1) stroke(node(i, j), node(i, j + 1));
            if (i < i1) stroke(node(i, j), node(i + 1, j));
          }
      }
      context.stroke();
      if (others) crowd(context, looks, others);
      const polygons = [], shadows = [];
      const falls = data.planes.slice(0, 1).map(([n, offset]) => x => sub(x, times(up, (dot(x, n) - offset) / dot(up, n))));
      data.tracks.forEach((track, k) => {
        const poses = at(track, frame);
        for (const solid of solids) {
          // What stands in the scene is drawn once.
          const still = solid.link === null, at = x => still ? x : place(poses[solid.link], x);
          if (still && k) continue;
          // A ghost stands back a little, so that where both agree the first is seen.
          const far = x => norm(sub(x, eye)) + 0.02 * k, centre = at(solid.pose.slice(0, 3));
          const wide = 2 * solid.size[0] * focus / far(centre);
          if (solid.ends && wide < 4 * scale) {
            const world = solid.ends.map(at), seen = world.map(see);
            const colour = k ? `hsla(${solid.hue} 10% 40% / 0.5)` : `hsl(${solid.hue} 75% 45%)`;
            if (k === 0) for (const fall of falls) shadows.push(world.map(fall).map(see));
            if (seen.every(p => p[2] > near)) polygons.push([far(centre), colour, seen, Math.max(wide, 2 * scale)]);
            continue;
          }
          const corners = solid.corners.map(at), places = corners.map(see);
          for (const face of solid.faces) {
            const world = face.map(k => corners[k]), seen = face.map(k => places[k]);
            const across = cross(sub(world[2], world[0]), sub(world.at(-1), world[1])), length = norm(across);
            if (length < 1e-12) continue;
            const normal = times(across, 1 / length), centre = middle(world);
            if (k === 0 && dot(normal, up) > 0)
              for (const fall of falls) if (dot(sub(centre, fall(centre)), up) > 0) shadows.push(world.map(fall).map(see));
            if (dot(normal, sub(eye, centre)) < 0) continue;
            if (seen.some(p => p[2] < near)) continue;
            const shade = Math.round(34 + 40 * Math.max(0, dot(normal, light)));
            const colour = k ? `hsla(${solid.hue} 10% ${shade}% / 0.35)` : `hsl(${solid.hue} ${still ? 8 : 45}% ${shade + 15 * still}%)`;
            // What lies on a face of the scene is painted after it.
            polygons.push([still ? Math.max(...world.map(far)) : far(centre), colour, seen, 0.7]);
          }
        }
      });
      context.fillStyle = context.strokeStyle = "#dfe2e7";
      context.lineCap = "round";
      context.lineWidth = 2 * scale;
      context.beginPath();
      for (const seen of shadows.filter(seen => seen.every(p => p[2] > near))) trace(context, seen);
      context.fill();
      if (shadows.some(seen => seen.length === 2)) context.stroke();
      polygons.sort((a, b) => b[0] - a[0]);
      for (const [, colour, seen, width] of polygons) {
        context.fillStyle = context.strokeStyle = colour;
        context.lineWidth = width;
        context.beginPath();
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
    // The camera's place, and how the mouse moves it about.
    const view = { turn: -0.6, lift: 0.35, distance: 3 * reach + 0.2 };
    const turn = e => {
      view.turn -= 0.008 * e.movementX;
      view.lift = Math.min(1.5, Math.max(-0.2, view.lift + 0.006 * e.movementY));
    };
    return { paint, camera, place, turn, view };
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
    const { paint, turn, view } = painter(data);
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
        context.beginPath();
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
    canvas.onpointerdown = e => canvas.setPointerCapture(e.pointerId);
    canvas.onpointermove = e => { if (e.buttons) { turn(e); draw(); } };
    canvas.onwheel = e => { e.preventDefault(); view.distance *= Math.exp(e.deltaY * 0.001); draw(); };
    window.addEventListener("resize", draw);
    draw();
    requestAnimationFrame(tick);
  };
  replay.painter = painter;
  return replay;
})();
