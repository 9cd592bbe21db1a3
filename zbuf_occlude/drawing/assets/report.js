/* The report's page: two selectors choose whose worst view of which mesh the CloudViewer shows. */
"use strict";

(() => {
  const data = JSON.parse(document.getElementById("worst-views").textContent);
  const canvas = document.getElementById("worst-view");
  if (!canvas) return;
  const viewer = new CloudViewer(canvas);
  const mesh = document.getElementById("mesh"), subject = document.getElementById("subject");
  const fact = document.getElementById("fact");
  window.worstViewer = viewer;

  const unpacked = (text) => {  // four outcomes of two bits in a byte, the first lowest
    const packed = CloudViewer.bytes(text), codes = new Uint8Array(4 * packed.length);
    packed.forEach((byte, i) => { for (let j = 0; j < 4; j++) codes[4 * i + j] = (byte >> (2 * j)) & 3; });
    return codes;
  };
  const percent = (fraction) => (100 * fraction).toPrecision(fraction ? 2 : 1) + " %";
  const fill = (select, names) => select.replaceChildren(...names.map((name) => new Option(name, name)));

  const show = (keepView) => {
    const cloud = data.clouds[mesh.value], worst = cloud.worst[subject.value];
    const codes = unpacked(worst.outcomes).subarray(0, worst.n);
    const view = {azimuth: worst.azimuth + 40, elevation: Math.max(-60, Math.min(60, worst.elevation + 15))};
    viewer.show({...cloud, codes, n: worst.n, palette: data.palette, emphasis: [2, 3]}, keepView ? null : view);
    fact.innerHTML = "";
    fact.append(
      "Its worst view of these: azimuth " + Math.round(worst.azimuth) + "°, elevation " + Math.round(worst.elevation) +
      "°. Of " + worst.n.toLocaleString("en") + " points " + percent(worst.false_visible) + " are false visible and " +
      percent(worst.false_hidden) + " false hidden.");
  };
  const subjects = () => {
    const before = subject.value, names = Object.keys(data.clouds[mesh.value].worst);
    fill(subject, names);
    subject.value = names.includes(before) ? before : names.includes(data.first) ? data.first : names[0];
  };
  mesh.addEventListener("change", () => { subjects(); show(false); });
  subject.addEventListener("change", () => show(false));
  document.getElementById("camera").addEventListener("click", () => {
    const worst = data.clouds[mesh.value].worst[subject.value];
    viewer.turn(worst.azimuth, worst.elevation);
  });
  document.getElementById("aside").addEventListener("click", () => viewer.reset());
  document.querySelectorAll(".legend input").forEach((box) => {
    box.addEventListener("change", () => viewer.setShown(Number(box.value), box.checked));
    viewer.setShown(Number(box.value), box.checked);
  });
  fill(mesh, Object.keys(data.clouds));
  subjects();
  show(false);
})();
