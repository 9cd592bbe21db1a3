/* The gallery's page: a CloudViewer for each cloud, and a large one for the cloud that was clicked last. */
"use strict";

(() => {
  const data = JSON.parse(document.getElementById("clouds").textContent);
  const place = document.getElementById("classes"), fact = document.getElementById("fact");
  const all = document.getElementById("all"), ghost = document.getElementById("ghost");
  const selector = document.getElementById("class");
  const large = new CloudViewer(document.getElementById("large"));
  const small = [];
  const colour = document.getElementById("colour");
  let chosen = null, shown = null;

  // scans know more of their points: the colouring that was chosen lies over the class's colour
  const painted = (cloud) => ({...cloud, ...((cloud.colourings || {})[colour.value] || {})});

  // aside of the camera, so that the missing side shows
  const aside = (cloud) => ({azimuth: cloud.azimuth + 60, elevation: Math.max(-40, Math.min(40, cloud.elevation + 10))});

  const turn = large.turn.bind(large);
  large.turn = (azimuth, elevation) => {
    turn(azimuth, elevation);
    if (all.checked) small.forEach((viewer) => viewer.turn(large.azimuth, large.elevation));
  };

  const choose = (cell, name, cloud) => {
    if (chosen) chosen.classList.remove("chosen");
    chosen = cell;
    cell.classList.add("chosen");
    large.camera = {azimuth: cloud.azimuth, elevation: cloud.elevation};
    shown = cloud;
    large.show(painted(cloud), aside(cloud));
    fact.textContent = name + ", " + cloud.mesh + ", variation " + cloud.variation + ": camera at azimuth " +
      cloud.azimuth + "°, elevation " + cloud.elevation + "°; " + cloud.seen + "; " + cloud.n_own + " are shown.";
  };

  for (const row of data.classes) {
    const line = document.createElement("div"), title = document.createElement("h3");
    const cells = document.createElement("div");
    line.className = "row";
    cells.className = "cells";
    title.textContent = row.name;
    for (const cloud of row.clouds) {
      const cell = document.createElement("div"), canvas = document.createElement("canvas");
      const caption = document.createElement("span");
      cell.className = "cell";
      caption.textContent = "az " + Math.round(cloud.azimuth) + "°, el " + Math.round(cloud.elevation) + "°";
      canvas.setAttribute("aria-label", row.name + " " + caption.textContent);
      cell.append(canvas, caption);
      cells.append(cell);
      const viewer = new CloudViewer(canvas);
      viewer.show(painted(cloud), aside(cloud));
      viewer.repaint = () => viewer.show(painted(cloud));
      small.push(viewer);
      canvas.addEventListener("click", () => choose(cell, row.name, cloud));
    }
    line.append(title, cells);
    place.append(line);
    selector.append(new Option(row.name, row.name));
  }
  document.getElementById("camera").addEventListener("click", () => large.turn(large.camera.azimuth, large.camera.elevation));
  document.getElementById("aside").addEventListener("click", () => large.reset());
  selector.addEventListener("change", () => {
    [...place.children].forEach((line, i) => { line.hidden = selector.value !== "" && data.classes[i].name !== selector.value; });
    const shownCell = place.querySelector(".row:not([hidden]) .cell canvas");
    if (shownCell && selector.value) shownCell.click();
  });
  const ghosts = () => [large, ...small].forEach((viewer) => [1, 2].forEach((code) => viewer.setShown(code, ghost.checked)));
  ghost.addEventListener("change", ghosts);
  all.addEventListener("change", () => large.turn(large.azimuth, large.elevation));
  const colourings = Object.keys((data.classes[0] && data.classes[0].clouds[0].colourings) || {});
  colourings.forEach((name) => colour.append(new Option(name, name)));
  if (colourings.includes("own colour")) {
    colour.value = "own colour";
    small.forEach((viewer) => viewer.repaint());
  }
  document.getElementById("colours").hidden = !colourings.length;
  colour.addEventListener("change", () => {
    small.forEach((viewer) => viewer.repaint());
    if (shown) large.show(painted(shown));
  });
  const first = place.querySelector(".cell");
  if (first) choose(first, data.classes[0].name, data.classes[0].clouds[0]);
  window.gallery = {large, small};
})();
