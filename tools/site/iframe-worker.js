// A page that was opened from a folder may start no worker: the search's code runs in a frame then.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.body.appendChild(this.frame);
      const inside = this.frame.contentWindow;
      inside.document.open();
      inside.document.write(`<script>
        window.told = [];
        window.addEventListener = (kind, f) => kind === "message" && told.push(f);
        window.postMessage = (data) => window.answer(data);
        window.importScripts = () => {};
      </script>`);
      inside.answer = (data) => {
        const event = new MessageEvent("message", { data });
        this.dispatchEvent(event);
        if (this.onmessage) this.onmessage(event);
      };
      inside.document.write(`<script src="${new URL(url, location)}"></` + "script>");
      inside.document.close();
      this.ready = new Promise((done) => inside.document.querySelectorAll("script")[1].onload = done);
    }
    postMessage(data) {
      const inside = this.frame.contentWindow;
      this.ready.then(() => inside.told.forEach((f) => f({ data })));
    }
    terminate() { this.frame.remove(); }
  };
}
