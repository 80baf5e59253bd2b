"use strict";
// The robot of a page as a body that one can turn, drawn by three.js; every place comes from the page.
// Where the browser has no WebGL, the still picture stays.
window.RobotFigure = (() => {
  const TURN = Math.PI / 18, ZOOM = 1.15;  // of one press of a key [rad], and of a zoom
  const FIELD = 30, HEIGHT = 420;  // of the camera [°], of the picture [px]
  const THIN = .0035, HEAD = .028, AXIS = .09;  // of arrows and of the sensor's axes [m]
  const CREASE = .6;  // angle between faces that look round together [rad]

  function solid(part, colour) {
    const corners = new Float32Array(9 * part.faces.length);
    part.faces.flat().forEach((place, n) => corners.set(part.places[place], 3 * n));
    const flat = new THREE.BufferGeometry();
    flat.setAttribute("position", new THREE.BufferAttribute(corners, 3));
    const mesh = new THREE.Mesh(THREE.toCreasedNormals(flat, CREASE), new THREE.MeshLambertMaterial({color: colour}));
    mesh.userData.words = `${part.name}${part.share ? `: ${part.share.toFixed(2)}` : ", not named"}`;
    return mesh;
  }

  // an arrow along y of length 1 at first: a shaft, and one or two heads at its end
  function arrow(heads) {
    const group = new THREE.Group();
    const paint = new THREE.MeshBasicMaterial({depthTest: false, transparent: true});
    const piece = geometry => {
      const mesh = new THREE.Mesh(geometry, paint);
      mesh.renderOrder = 2;  // over the robot: a residual is never hidden
      group.add(mesh);
    };
    piece(new THREE.CylinderGeometry(THIN, THIN, 1, 10));
    for (let n = 0; n < heads; n++) piece(new THREE.ConeGeometry(.4 * HEAD, HEAD, 14));
    group.matrixAutoUpdate = true;
    return group;
  }

  function point(group, vector) {
    const to = new THREE.Vector3(...vector), length = to.length(), head = Math.min(HEAD, length);
    const [shaft, ...heads] = group.children;
    group.visible = length > 1e-4;
    if (!group.visible) return;
    group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), to.normalize());
    shaft.scale.y = Math.max(1e-6, length - head);
    shaft.position.y = .5 * (length - head);
    heads.forEach((cone, n) => {
      cone.scale.setScalar(head / HEAD);
      cone.position.y = length - head * (.5 + .8 * n);
    });
  }

  return class {
    static able() {
      return Boolean(window.THREE && document.createElement("canvas").getContext("webgl2"));
    }

    // page: what a page's script lends: make, colour, role, and tell, which moves all cursors
    constructor(node, data, page) {
      Object.assign(this, {node, data, page, at: data.first, bodies: [], arrows: []});
      this.renderer = new THREE.WebGLRenderer({antialias: true, alpha: true});
      this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
      this.ground = this.renderer.domElement;
      Object.assign(this.ground, {className: "live turned", tabIndex: 0});
      this.ground.setAttribute("role", "application");
      this.ground.setAttribute("aria-label", `${data.title}: arrow keys turn it, + and − zoom, Home turns it back`);
      this.said = page.make("output", {className: "said"});
      node.querySelector(".still").after(this.buttons(), this.ground, this.bar(), this.slider(), this.said);
      node.classList.add("alive");
      this.build();
      this.listen();
      this.again();
    }

    // ---- what is beside the picture ----------------------------------------------------------
    buttons() {
      const {make} = this.page, row = make("div", {className: "tools"});
      this.data.arrows.forEach((a, n) => {
        const key = make("button", {type: "button", className: "key line", textContent: a.name});
        key.style.setProperty("--key", `var(${this.page.variable(a.role)})`);
        key.setAttribute("aria-pressed", "true");
        key.onclick = () => {
          this.arrows[n].shown = !this.arrows[n].shown;
          key.setAttribute("aria-pressed", String(this.arrows[n].shown));
          this.show(this.at);
        };
        row.append(key);
      });
      const back = make("button", {type: "button", textContent: "turn back", onclick: () => this.home()});
      row.append(back);
      return row;
    }

    bar() {
      const {make} = this.page, colours = make("span", {className: "blame"});
      colours.style.background = `linear-gradient(to right, ${this.data.ramp.join(", ")})`;
      return make("p", {className: "tools note"}, "0 ", colours, " 1: the cause is certain to be there");
    }

    slider() {
      const {make} = this.page;
      this.words = make("span");
      this.range = make("input", {type: "range", min: 0, max: this.data.labels.length - 1, step: 1, value: this.at});
      this.range.oninput = () => this.choose(+this.range.value);
      return make("label", {className: "tools moment"}, this.range, this.words);
    }

    // ---- the scene ---------------------------------------------------------------------------
    build() {
      this.scene = new THREE.Scene();
      this.camera = new THREE.PerspectiveCamera(FIELD, 1, .01, 100);
      this.camera.up.set(0, 0, 1);
      const sun = new THREE.DirectionalLight("white", 1.7);
      sun.position.set(.6, .8, 1);
      this.camera.add(sun);
      this.scene.add(this.camera, new THREE.HemisphereLight("white", "#8a8f96", 1.7));
      for (let n = 0; n < this.data.frames[0].length; n++) {
        const body = new THREE.Group();
        body.matrixAutoUpdate = false;
        this.bodies.push(body);
        this.scene.add(body);
      }
      for (const part of this.data.parts) this.bodies[part.body].add(solid(part, this.blame(part.share)));
      const sensor = this.bodies.at(-1), axes = new THREE.AxesHelper(AXIS);
      axes.material.depthTest = false;
      axes.renderOrder = 1;
      sensor.add(axes);
      for (const a of this.data.arrows) {
        const group = arrow(a.heads);
        this.arrows.push({group, shown: true});
        sensor.add(group);
      }
      this.controls = new THREE.OrbitControls(this.camera, this.ground);
      this.ground.style.touchAction = "pan-y";  // a finger still scrolls the page
      this.place(this.at);
      this.fit();
    }

    blame(share) {
      const at = Math.min(share, .9999) * (this.data.ramp.length - 1), low = Math.floor(at);
      return new THREE.Color(this.data.ramp[low]).lerp(new THREE.Color(this.data.ramp[low + 1]), at - low);
    }

    // in view: the robot as it stands first, and where its bodies are at any moment
    fit() {
      this.scene.updateMatrixWorld(true);
      const seen = this.data.frames.flat().map(rows => new THREE.Vector3(...rows.map(row => row[3])));
      const now = new THREE.Box3(), corner = new THREE.Vector3();
      for (const part of this.data.parts) for (const place of part.places) {
        corner.set(...place).applyMatrix4(this.bodies[part.body].matrix);
        now.expandByPoint(corner);
        seen.push(corner.clone());
      }
      const back = new THREE.Vector3(...this.data.eye).normalize();
      const right = new THREE.Vector3(0, 0, 1).cross(back).normalize();
      const ways = [right, back.clone().cross(right), back];
      this.middle = new THREE.Vector3();
      this.half = ways.map(way => {
        const along = seen.map(p => p.dot(way)), low = Math.min(...along), high = Math.max(...along);
        this.middle.addScaledVector(way, .5 * (low + high));
        return .5 * (high - low);
      });
      const size = Math.max(...this.half);
      this.floor = new THREE.GridHelper(8 * size, 32);
      this.floor.rotation.x = Math.PI / 2;
      this.floor.position.set(this.middle.x, this.middle.y, now.min.z);
      this.scene.add(this.floor);
    }

    home() {
      const [wide, high, deep] = this.half, across = Math.max(high, wide / this.camera.aspect);
      const far = 1.08 * across / Math.tan(FIELD * Math.PI / 360) + deep;
      this.controls.target.copy(this.middle);
      this.camera.position.set(...this.data.eye).setLength(far).add(this.middle);
      this.controls.update();
      this.render();
    }

    turn(round, up, closer = 1) {
      const from = this.camera.position.clone().sub(this.controls.target);
      const ball = new THREE.Spherical().setFromVector3(new THREE.Vector3(from.x, from.z, -from.y));
      ball.theta += round;
      ball.phi -= up;
      ball.radius /= closer;
      const to = new THREE.Vector3().setFromSpherical(ball.makeSafe());
      this.camera.position.set(to.x, -to.z, to.y).add(this.controls.target);
      this.controls.update();
      this.render();
    }

    // ---- moments -----------------------------------------------------------------------------
    place(n) {
      this.data.frames[n].forEach((rows, b) => this.bodies[b].matrix.set(...rows.flat(), 0, 0, 0, 1));
      this.data.arrows.forEach((a, k) => {
        point(this.arrows[k].group, a.vectors[n]);
        this.arrows[k].group.visible &&= this.arrows[k].shown;
      });
    }

    show(n) {
      this.at = n;
      this.place(n);
      this.range.value = n;
      this.range.setAttribute("aria-label", "moment of the robot");
      this.range.setAttribute("aria-valuetext", this.data.labels[n]);
      this.words.textContent = this.data.labels[n];
      this.render();
    }

    choose(n) {
      this.show(n);
      this.page.tell(this, this.data.ids[n]);
    }

    follow(id) {
      this.show(this.page.nearest(this.data.ids, id));
    }

    render() { this.renderer.render(this.scene, this.camera); }

    // the page is as wide, or as dark, as it was not before
    again() {
      const width = this.node.clientWidth, height = Math.min(HEIGHT, .85 * width);
      this.renderer.setSize(width, height);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
      this.data.arrows.forEach((a, n) => this.arrows[n].group.children[0].material.color.set(this.page.role(a.role)));
      this.floor.material.vertexColors = false;
      this.floor.material.color.set(this.page.colour("--line"));
      this.home();
      this.show(this.at);
    }

    listen() {
      const keys = {ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, TURN], ArrowDown: [0, -TURN],
        "+": [0, 0, ZOOM], "-": [0, 0, 1 / ZOOM]};
      this.ground.addEventListener("keydown", event => {
        if (event.key === "Home") this.home();
        else if (keys[event.key]) this.turn(...keys[event.key]);
        else return;
        event.preventDefault();
      });
      // the wheel scrolls the page, and zooms with Ctrl, as over every figure
      this.ground.addEventListener("wheel", event => { this.controls.enableZoom = event.ctrlKey; }, {capture: true, passive: true});
      this.controls.addEventListener("change", () => this.render());
      const ray = new THREE.Raycaster();
      this.ground.addEventListener("pointermove", event => {
        const box = this.ground.getBoundingClientRect();
        ray.setFromCamera(new THREE.Vector2(2 * (event.clientX - box.left) / box.width - 1,
          1 - 2 * (event.clientY - box.top) / box.height), this.camera);
        const [hit] = ray.intersectObjects(this.bodies).filter(h => h.object.userData.words);
        this.said.textContent = hit?.object.userData.words ?? "";
      });
      this.ground.addEventListener("pointerleave", () => { this.said.textContent = ""; });
    }
  };
})();
