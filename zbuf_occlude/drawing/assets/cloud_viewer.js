/* A point cloud in a canvas: drag turns it, the wheel zooms, arrow keys turn, double click or Home goes back.
 *
 * One file, no dependency, 2D canvas: round marks are splatted into an image with a depth buffer of its own, so it
 * runs wherever a browser does, without WebGL.
 *
 *   const viewer = new CloudViewer(canvas, {background: [255, 255, 255]});
 *   viewer.show(cloud, {azimuth: 30, elevation: 20});        // degrees
 *   viewer.setShown(code, false);                             // hide the points of one code
 *   viewer.turn(azimuth, elevation);
 *
 * cloud, as zbuf_occlude.drawing.pages.pack_cloud makes it:
 *   n          number of points
 *   positions  base64 of int16 x, y, z: 32767 is one longest side of the object from its centre
 *   normals    base64 of int8 x, y, z (127 is 1), either sign, or null
 *   codes      base64 of uint8 (or a Uint8Array), an index into palette for each point, or null (all 0)
 *   palette    [[r, g, b], ...] in 0..255
 *   emphasis   codes drawn last, larger and unshaded, e.g. [2, 3]; may be missing
 */
"use strict";

class CloudViewer {
  constructor(canvas, options = {}) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.background = options.background || [255, 255, 255];
    this.cloud = null;
    this.hidden = new Set();
    this.home = {azimuth: 30, elevation: 20};
    this.frames = 0;
    this.reset();
    this.listen();
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  show(cloud, view) {
    const shorts = new Int16Array(CloudViewer.bytes(cloud.positions).buffer);
    const normals = cloud.normals ? new Int8Array(CloudViewer.bytes(cloud.normals).buffer) : null;
    const codes = !cloud.codes ? new Uint8Array(cloud.n)
      : cloud.codes instanceof Uint8Array ? cloud.codes : CloudViewer.bytes(cloud.codes);
    this.cloud = {n: Math.min(cloud.n, codes.length), shorts, normals, codes, palette: cloud.palette,
                  emphasis: new Set(cloud.emphasis || [])};
    if (view) { this.home = view; this.reset(); }
    this.draw();
  }

  setShown(code, shown) {
    if (shown) this.hidden.delete(code); else this.hidden.add(code);
    this.draw();
  }

  turn(azimuth, elevation) {
    this.azimuth = azimuth;
    this.elevation = Math.max(-90, Math.min(90, elevation));
    this.draw();
  }

  reset() {
    this.zoom = 1;
    this.turn(this.home.azimuth, this.home.elevation);
  }

  listen() {
    const canvas = this.canvas, pointers = new Map();
    canvas.style.touchAction = "none";
    canvas.tabIndex = 0;
    canvas.addEventListener("pointerdown", (event) => {
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      try { canvas.setPointerCapture(event.pointerId); } catch (error) { /* a synthetic pointer cannot be captured */ }
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      if (pointers.size === 2) {
        const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
        const span = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
        this.scale(span(now) / span(before));
      } else {
        this.turn(this.azimuth - 0.4 * (now[0] - before[0]), this.elevation + 0.4 * (now[1] - before[1]));
      }
      pointers.set(event.pointerId, now);
    });
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.scale(Math.exp(-0.0012 * event.deltaY));
    }, {passive: false});
    canvas.addEventListener("dblclick", () => this.reset());
    canvas.addEventListener("keydown", (event) => {
      const steps = {ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, 6], ArrowDown: [0, -6]};
      if (steps[event.key]) {
        event.preventDefault();
        this.turn(this.azimuth + steps[event.key][0], this.elevation + steps[event.key][1]);
      } else if (event.key === "Home") {
        this.reset();
      }
    });
  }

  scale(factor) {
    this.zoom = Math.max(0.3, Math.min(20, this.zoom * factor));
    this.draw();
  }

  draw() {
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => { this.pending = 0; this.render(); });
  }

  render() {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(this.canvas.clientWidth * ratio), height = Math.round(this.canvas.clientHeight * ratio);
    if (!this.cloud || !width || !height) return;
    if (this.canvas.width !== width || this.canvas.height !== height || !this.image) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.image = this.context.createImageData(width, height);
      this.pixels = new Uint32Array(this.image.data.buffer);
      this.depth = new Float32Array(width * height);
    }
    const [red, green, blue] = this.background;
    this.pixels.fill((255 << 24) | (blue << 16) | (green << 8) | red);
    this.depth.fill(Infinity);
    const {n, shorts, normals, codes, palette, emphasis} = this.cloud;
    const az = this.azimuth * Math.PI / 180, el = this.elevation * Math.PI / 180;
    const back = [Math.cos(el) * Math.cos(az), Math.cos(el) * Math.sin(az), Math.sin(el)];
    const right = [-Math.sin(az), Math.cos(az), 0];
    const up = [-Math.sin(el) * Math.cos(az), -Math.sin(el) * Math.sin(az), Math.cos(el)];
    const light = [0, 1, 2].map((i) => -0.45 * right[i] + 0.55 * up[i] + 0.70 * back[i]);
    const distance = 4, side = Math.min(width, height), focal = 0.86 * side * this.zoom * distance;
    // about one mark's area for each point of what the object covers
    const mark = Math.max(1, Math.min(5 * ratio * Math.sqrt(Math.max(1, this.zoom)), 0.55 * side * this.zoom / Math.sqrt(n)));
    for (let i = 0; i < n; i++) {
      const code = codes[i];
      if (this.hidden.has(code)) continue;
      const x = shorts[3 * i] / 32767, y = shorts[3 * i + 1] / 32767, z = shorts[3 * i + 2] / 32767;
      const depth = distance - (x * back[0] + y * back[1] + z * back[2]);
      if (depth <= 0.1) continue;
      const px = width / 2 + focal * (x * right[0] + y * right[1]) / depth;
      const py = height / 2 - focal * (x * up[0] + y * up[1] + z * up[2]) / depth;
      const strong = emphasis.has(code);
      let shade = 1;
      if (!strong) {
        if (normals) {
          const a = normals[3 * i], b = normals[3 * i + 1], c = normals[3 * i + 2];
          const sign = a * back[0] + b * back[1] + c * back[2] < 0 ? -1 : 1;
          shade = 0.45 + 0.55 * Math.max(0, sign * (a * light[0] + b * light[1] + c * light[2]) / 127);
        }
        shade *= Math.max(0.35, Math.min(1, 0.85 - 0.6 * (depth - distance)));
      }
      const [r, g, b] = palette[code];
      const colour = (255 << 24) | ((b * shade) << 16) | ((g * shade) << 8) | (r * shade);
      this.splat(px, py, strong ? depth - 0.02 : depth, strong ? mark * 1.3 : mark, colour, width, height);
    }
    this.context.putImageData(this.image, 0, 0);
    this.frames++;
  }

  splat(px, py, depth, mark, colour, width, height) {
    const left = Math.max(0, Math.round(px - mark / 2)), right = Math.min(width, Math.round(px + mark / 2));
    const top = Math.max(0, Math.round(py - mark / 2)), bottom = Math.min(height, Math.round(py + mark / 2));
    const round = mark > 2 ? mark * mark / 4 : Infinity;
    for (let row = top; row < bottom; row++) {
      const down = (row + 0.5 - py) ** 2;
      for (let at = row * width + left, end = row * width + right; at < end; at++) {
        if (depth < this.depth[at] && down + (at - row * width + 0.5 - px) ** 2 <= round) {
          this.depth[at] = depth;
          this.pixels[at] = colour;
        }
      }
    }
  }

  static bytes(text) {
    return Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  }
}
