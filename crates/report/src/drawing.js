// What views of meshes share: one WebGL 2 context, since browsers give out few, and what is drawn with
// it. Each view copies the drawing into its own canvas.
"use strict";
const bokashiDrawing = (() => {
  const VERTEX = `#version 300 es
    in vec3 position, color; in vec2 coordinates;
    uniform mat4 view, lens;
    out vec3 eye, tint, corner; out vec2 at;
    void main() {
      int k = gl_VertexID % 3;
      corner = vec3(k == 0, k == 1, k == 2);
      eye = (view * vec4(position, 1.0)).xyz;
      tint = color; at = coordinates;
      gl_Position = lens * vec4(eye, 1.0);
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 eye, tint, corner; in vec2 at;
    uniform sampler2D image; uniform bool pictured; uniform int look;
    out vec4 result;
    void main() {
      vec3 normal = cross(dFdx(eye), dFdy(eye)); // of the face: shading is flat
      float light = abs(dot(normal, eye)) / max(length(normal) * length(eye), 1e-30);
      vec3 color = vec3(0.78, 0.8, 0.84) * mix(0.2, 1.0, light);
      if (look == 0) color = (pictured ? texture(image, at).rgb : tint) * mix(0.6, 1.0, light);
      vec3 slope = max(fwidth(corner), vec3(1e-6)), pixels = corner / slope;
      float edge = 1.0 - smoothstep(0.4, 1.4, min(pixels.x, min(pixels.y, pixels.z)));
      // Where faces are as small as pixels, lines would hide the surface.
      edge *= clamp(0.2 / max(slope.x, max(slope.y, slope.z)), 0.0, 0.85);
      if (look == 2) color = mix(color, vec3(0.05, 0.15, 0.35), edge);
      result = vec4(color, 1.0);
    }`;
  const TANGENT = Math.tan(Math.PI / 12); // of half the angle of view
  const all = new Set(); // the functions that upload the meshes of views
  let gl, program;

  // Makes the context, once; whether there is one.
  function ready() {
    if (gl !== undefined) return gl !== null;
    const canvas = document.createElement("canvas");
    gl = canvas.getContext("webgl2");
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => link() && all.forEach((upload) => upload()));
    if (!gl || !link()) gl = null;
    return gl !== null;
  }

  function link() {
    program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    ["position", "color", "coordinates"].forEach((name, k) => gl.bindAttribLocation(program, k, name));
    gl.linkProgram(program);
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    gl.vertexAttrib3f(1, 0.78, 0.8, 0.84); // what has no colours
    return gl.getProgramParameter(program, gl.LINK_STATUS);
  }

  function numbers(text, Kind) {
    const letters = atob(text), bytes = new Uint8Array(letters.length);
    for (let k = 0; k < bytes.length; k++) bytes[k] = letters.charCodeAt(k);
    return new Kind(bytes.buffer);
  }

  // The rows that faces name, one after the other.
  function spread(rows, faces, width) {
    const all = new rows.constructor(width * faces.length);
    for (let k = 0, at = 0; k < faces.length; k++)
      for (let column = 0; column < width; column++) all[at++] = rows[width * faces[k] + column];
    return all;
  }

  // A mesh as it is drawn: places in the scene, colours and coordinates of all corners, and its image.
  async function corners(mesh) {
    const faces = numbers(mesh.faces, Uint32Array), place = numbers(mesh.place, Float32Array);
    const own = spread(numbers(mesh.positions, Float32Array), faces, 3);
    const positions = new Float64Array(own.length);
    for (let k = 0; k < own.length; k++) {
      const row = k % 3, at = k - row;
      positions[k] =
        place[row] * own[at] + place[4 + row] * own[at + 1] + place[8 + row] * own[at + 2] + place[12 + row];
    }
    const colors = mesh.colors && spread(numbers(mesh.colors, Uint8Array), faces, 3);
    const coordinates = mesh.texture &&
      spread(numbers(mesh.coordinates, Float32Array), numbers(mesh.coordinateFaces, Uint32Array), 2);
    if (!mesh.texture) return { positions, colors };
    const image = new Image();
    image.src = mesh.texture;
    // A mesh whose image cannot be read is shown without.
    const read = await image.decode().then(() => true, () => false);
    return { positions, colors, coordinates, image: read ? image : null };
  }

  // The middle of all places that are finite, and how far they reach from there.
  function bounds(parts) {
    const ends = [[Infinity, -Infinity], [Infinity, -Infinity], [Infinity, -Infinity]];
    for (const { positions } of parts) positions.forEach((x, k) => {
      const end = ends[k % 3];
      if (Number.isFinite(x)) [end[0], end[1]] = [Math.min(end[0], x), Math.max(end[1], x)];
    });
    const middle = ends.map(([low, high]) => (low <= high ? (low + high) / 2 : 0));
    let radius = 0;
    for (const { positions: p } of parts) for (let k = 0; k < p.length; k += 3) {
      const far = Math.hypot(p[k] - middle[0], p[k + 1] - middle[1], p[k + 2] - middle[2]);
      if (far > radius && far < Infinity) radius = far;
    }
    return { middle, radius: radius || 1 };
  }

  function fill(part, at, values, width, kind) {
    part.buffers.push(gl.createBuffer());
    gl.bindBuffer(gl.ARRAY_BUFFER, part.buffers.at(-1));
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, width, kind, true, 0, 0);
  }

  function texture(image) {
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, image);
    gl.generateMipmap(gl.TEXTURE_2D);
    return made;
  }

  // Brings parts into the context, around their middle: there numbers of 32 bits are finest.
  function upload(parts, middle) {
    for (const part of parts) {
      const picture = part.image ? texture(part.image) : null;
      Object.assign(part, { array: gl.createVertexArray(), buffers: [], picture });
      gl.bindVertexArray(part.array);
      const near = new Float32Array(part.positions.length);
      for (let k = 0; k < near.length; k++) near[k] = part.positions[k] - middle[k % 3];
      fill(part, 0, near, 3, gl.FLOAT);
      if (part.colors) fill(part, 1, part.colors, 3, gl.UNSIGNED_BYTE);
      if (part.image) fill(part, 2, part.coordinates, 2, gl.FLOAT);
    }
  }

  function release(parts) {
    for (const part of parts) {
      gl.deleteVertexArray(part.array);
      part.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
      gl.deleteTexture(part.picture);
    }
  }

  // Draws into a canvas. The camera looks at a ball around the origin of the parts moved by `offset`.
  function draw(canvas, parts, { yaw, pitch, zoom, shift, offset, radius, reach, look }) {
    const scale = Math.min(devicePixelRatio, 2), screen = gl.canvas, page = canvas.getContext("2d");
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.round(x * scale));
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    if (screen.width < width) screen.width = width;
    if (screen.height < height) screen.height = height;
    gl.viewport(0, 0, width, height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [c, s, C, S] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    const rows = [[c, 0, s], [S * s, C, -S * c], [-C * s, S, C * c]];
    const [x, y, z] = rows.map((row) => row.reduce((sum, factor, k) => sum + factor * offset[k], 0));
    const away = 1.05 * radius / Math.sin(Math.atan(TANGENT)), span = Math.hypot(x, y, z) + reach;
    const near = Math.max(away - span, away / 1000), far = away + span;
    const view = [0, 1, 2].flatMap((k) => [...rows.map((row) => row[k]), 0]).concat(x, y, z - away, 1);
    const side = zoom / TANGENT * Math.min(width, height);
    const lens = [side / width, 0, 0, 0, 0, side / height, 0, 0, -shift[0], -shift[1],
      (near + far) / (near - far), -1, 0, 0, 2 * near * far / (near - far), 0];
    const at = (name) => gl.getUniformLocation(program, name);
    gl.uniformMatrix4fv(at("view"), false, view);
    gl.uniformMatrix4fv(at("lens"), false, lens);
    gl.uniform1i(at("look"), look);
    for (const part of parts) {
      gl.uniform1i(at("pictured"), part.picture ? 1 : 0);
      gl.bindTexture(gl.TEXTURE_2D, part.picture);
      gl.bindVertexArray(part.array);
      gl.drawArrays(gl.TRIANGLES, 0, part.positions.length / 3);
    }
    page.clearRect(0, 0, width, height);
    page.drawImage(screen, 0, screen.height - height, width, height, 0, 0, width, height);
  }

  return { ready, corners, bounds, upload, release, draw, all };
})();
