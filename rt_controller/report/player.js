"use strict";
// Draws and plays the drives of a figure of class "player" from the content that player.py gives.
for (const figure of document.querySelectorAll("figure.player")) {
  const { lines, drives, mark: [name, mark_s] } = JSON.parse(figure.querySelector("script").textContent);
  const svg = figure.querySelector("svg"), world = svg.querySelector("g");
  const { width, height } = svg.viewBox.baseVal;
  // Pixels per m, and the place of the car; two cars are around the middle, and both in the picture.
  const SCALE = 9, PLACE = [(drives.length > 1 ? 0.5 : 0.3) * width, 0.5 * height];
  const [play, mark, speed, slider] = ["play", "mark", "speed", "time"].map((name) =>
    figure.querySelector(`[name=${name}]`));
  // With reduced motion the picture changes twice a second only.
  const step_s = matchMedia("(prefers-reduced-motion: reduce)").matches ? 0.5 : 0.04;
  let time = 0, timer = 0;

  function add(kind, d = "", color = "") {
    const path = document.createElementNS(svg.namespaceURI, "path");
    path.setAttribute("class", kind);
    path.setAttribute("d", d);
    path.style.color = color;
    return world.appendChild(path);
  }

  for (const [kind, d] of Object.entries(lines)) add(kind, d);
  for (const drive of drives) {
    drive.trail = add("trail", "", drive.color);
    drive.horizon = add("horizon");
    drive.car = add("car", `${drive.outline}Z`, drive.color);
    drive.line = document.createElement("p");
    drive.line.className = "note";
    drive.line.innerHTML = `<b style="color:${drive.color}">■</b> <span></span> <output></output>`;
    drive.line.querySelector("span").textContent = drive.name;
    figure.querySelector(".controls").before(drive.line);
  }
  slider.max = Math.max(...drives.map((drive) => drive.time_s.at(-1)));

  function rowAt(drive) {
    const after = drive.time_s.findIndex((seconds) => seconds > time);
    return after < 0 ? drive.time_s.length - 1 : Math.max(after - 1, 0);
  }

  function show() {
    slider.value = time;
    slider.setAttribute("aria-valuetext", `${time.toFixed(2)} s`);
    for (const drive of drives) {
      const row = rowAt(drive);
      const planned = [0, 1, 2, 3].map((ago) => row - ago).find((k) => k in drive.horizons);
      const way = drive.x.slice(0, row + 1).map((x, k) => `${x},${drive.y[k]}`);
      drive.trail.setAttribute("d", `M${way.join("L")}`);
      drive.horizon.setAttribute("d", drive.horizons[planned] ?? "");
      drive.car.setAttribute("transform",
        `translate(${drive.x[row]} ${drive.y[row]}) rotate(${drive.yaw_deg[row]})`);
      drive.line.querySelector("output").textContent = drive.text[row];
    }
    const places = drives.map((drive) => [drive.x[rowAt(drive)], drive.y[rowAt(drive)]]);
    const [x, y] = [0, 1].map((k) => places.reduce((sum, at) => sum + at[k], 0) / places.length);
    const far = Math.max(...places.map((at) => Math.hypot(at[0] - x, at[1] - y)), 1);
    const scale = Math.min(SCALE, 0.45 * height / far);
    const [car] = drives; // its road points to the right
    world.setAttribute("transform", `translate(${PLACE.join(" ")}) scale(${scale} ${-scale}) ` +
      `rotate(${-car.road_deg[rowAt(car)]}) translate(${-x} ${-y})`);
  }

  function pause() {
    clearInterval(timer);
    timer = 0;
    play.textContent = "Play";
  }

  function advance() {
    time = Math.min(time + step_s * Number(speed.value), Number(slider.max));
    show();
    if (time >= Number(slider.max)) pause();
  }

  play.addEventListener("click", () => {
    if (timer) return pause();
    if (time >= Number(slider.max)) time = 0;
    timer = setInterval(advance, 1000 * step_s);
    play.textContent = "Pause";
  });
  slider.addEventListener("input", () => { time = Number(slider.value); show(); });
  mark.textContent = `To the ${name}`;
  mark.addEventListener("click", () => { pause(); time = mark_s; show(); });
  figure.hidden = false;
  show();
}
