"use strict";
// Plays the drives of a figure of class "player": moves what player.py has drawn.
for (const figure of document.querySelectorAll("figure.player")) {
  const { drives, whole, scale, place } = JSON.parse(figure.querySelector("script").textContent);
  const world = figure.querySelector(".world");
  const shapes = [...figure.querySelectorAll(".drive")].map((drive) => ({
    trail: drive.querySelector(".trail"),
    horizon: drive.querySelector(".horizon"),
    car: drive.querySelector(".car"),
  }));
  const [play, speed, slider, view] = ["play", "speed", "time", "view"].map((name) =>
    figure.querySelector(`[name=${name}]`));
  const outputs = figure.querySelectorAll("output");
  const trails = drives.map((drive) => drive.x.map((x, k) => `${x},${drive.y[k]}`));
  // With reduced motion the picture changes twice a second only.
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  let time = Number(slider.value), last = null, shown = 0;

  function rowAt(drive, seconds) {
    let low = 0, high = drive.time_s.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (drive.time_s[middle] <= seconds) low = middle; else high = middle - 1;
    }
    return low;
  }

  function horizonOf(drive, row) { // every fourth tick has one
    for (let k = row; k > row - 4; k -= 1) if (k in drive.horizons) return drive.horizons[k];
    return "";
  }

  function text(number, digits, unit) {
    return number === null ? `– ${unit}` : `${number.toFixed(digits)} ${unit}`;
  }

  function show() {
    slider.value = time;
    slider.setAttribute("aria-valuetext", `${time.toFixed(2)} s`);
    drives.forEach((drive, i) => {
      const row = rowAt(drive, time), x = drive.x[row], y = drive.y[row];
      const { trail, horizon, car } = shapes[i];
      trail.setAttribute("points", trails[i].slice(0, row + 1).join(" "));
      horizon.setAttribute("points", horizonOf(drive, row));
      car.setAttribute("transform", `translate(${x} ${y}) rotate(${drive.yaw_deg[row]})`);
      if (i === 0) {
        world.setAttribute("transform", view.checked ? whole :
          `translate(${place.join(" ")}) scale(${scale} ${-scale}) ` +
          `rotate(${-drive.road_deg[row]}) translate(${-x} ${-y})`);
      }
      outputs[i].textContent = [
        text(drive.time_s[row], 2, "s"),
        text(drive.speed_kmh[row], 0, "km/h"),
        `lateral error ${text(drive.error_mm[row], 0, "mm")}`,
        `steering wheel ${text(drive.wheel_deg[row], 1, "deg")}`,
        drive.mode[row],
      ].join("  ·  ");
    });
  }

  function setPlaying(isPlaying) {
    last = null;
    play.textContent = isPlaying ? "Pause" : "Play";
    if (isPlaying) requestAnimationFrame(advance);
  }

  function advance(now) {
    if (play.textContent !== "Pause") return;
    time = Math.min(time + (last === null ? 0 : (now - last) / 1000 * Number(speed.value)),
      Number(slider.max));
    last = now;
    const isOver = time >= Number(slider.max);
    if (isOver || !calm.matches || now - shown >= 500) {
      shown = now;
      show();
    }
    if (isOver) setPlaying(false); else requestAnimationFrame(advance);
  }

  play.addEventListener("click", () => {
    const isPlaying = play.textContent === "Play";
    if (isPlaying && time >= Number(slider.max)) time = 0;
    setPlaying(isPlaying);
  });
  slider.addEventListener("input", () => { time = Number(slider.value); show(); });
  view.addEventListener("change", show);
  figure.querySelector(".controls").hidden = false;
  show();
}
