/* Pages opened from disk may start no workers. There the search runs in a hidden frame instead, which looks like one. */
"use strict";

if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.body.append(this.frame);
      const inside = this.frame.contentWindow, page = this.frame.contentDocument;
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", {data}));
      inside.importScripts = (...urls) => urls.reduce((before, each) => before.then(() => load(page, each)), Promise.resolve());
      this.ready = load(page, new URL(url, location.href).href);
    }

    set onmessage(listener) { this.addEventListener("message", (event) => listener.call(this, event)); }

    postMessage(data) {
      this.ready.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", {data})));
    }

    terminate() { this.frame.remove(); }
  };

  const load = (page, url) => new Promise((done, failed) => {
    const script = page.createElement("script");
    script.src = url;
    script.onload = done;
    script.onerror = () => failed(new Error("cannot load " + url));
    page.documentElement.append(script);
  });
}
