"use strict";
// The little of WebGL 2 that the page needs.
(() => {
  const WHOLE = `#version 300 es
    void main() { vec2 p = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2); gl_Position = vec4(p * 2. - 1., 0, 1); }`;

  class Program {
    constructor(gl, fragment, vertex = WHOLE) {
      Object.assign(this, { gl, fragment, vertex });
    }

    // Compiled when it is used first: without a graphics processor that takes long.
    compile() {
      const { gl, fragment, vertex } = this;
      this.program = gl.createProgram();
      for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        gl.attachShader(this.program, shader);
        if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
          throw new Error(gl.getShaderInfoLog(shader));
      }
      gl.linkProgram(this.program);
      if (!gl.getProgramParameter(this.program, gl.LINK_STATUS) && !gl.isContextLost())
        throw new Error(gl.getProgramInfoLog(this.program));
      this.places = new Map();
      const block = gl.getUniformBlockIndex(this.program, "Chosen");
      if (block !== gl.INVALID_INDEX) gl.uniformBlockBinding(this.program, block, 0);
    }

    at(name) {
      if (!this.places.has(name)) this.places.set(name, this.gl.getUniformLocation(this.program, name));
      return this.places.get(name);
    }

    // Sets uniforms: whole numbers as {int}, textures as {unit, target, texture}, others by their length.
    use(values) {
      const gl = this.gl;
      if (!this.program) this.compile();
      gl.useProgram(this.program);
      for (const [name, value] of Object.entries(values)) {
        const at = this.at(name);
        if (typeof value === "number") gl.uniform1f(at, value);
        else if (value.int !== undefined) gl.uniform1i(at, value.int);
        else if (value.texture !== undefined) {
          gl.activeTexture(gl.TEXTURE0 + value.unit);
          gl.bindTexture(value.target || gl.TEXTURE_2D, value.texture);
          gl.uniform1i(at, value.unit);
        } else if (value.length === 16) gl.uniformMatrix4fv(at, false, value);
        else gl[`uniform${value.length}fv`](at, value);
      }
    }
  }

  function texture(gl, target, filter) {
    const made = gl.createTexture();
    gl.bindTexture(target, made);
    for (const name of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"]) gl.texParameteri(target, gl[name], gl[filter]);
    for (const name of ["TEXTURE_WRAP_S", "TEXTURE_WRAP_T"]) gl.texParameteri(target, gl[name], gl.CLAMP_TO_EDGE);
    return made;
  }

  // A map of numbers (H, W), one float each.
  function floatTexture(gl, values, width, height) {
    const made = texture(gl, gl.TEXTURE_2D, "NEAREST");
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R32F, width, height, 0, gl.RED, gl.FLOAT, values);
    return made;
  }

  // 256 colours.
  function colourTexture(gl, table) {
    const made = texture(gl, gl.TEXTURE_2D, "NEAREST");
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, table);
    return made;
  }

  // Something to draw on, and to read from.
  function target(gl, width, height) {
    const colour = texture(gl, gl.TEXTURE_2D, "LINEAR");
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, width, height);
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, colour, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return { frame, texture: colour, width, height };
  }

  Object.assign(LF, { Program, texture, floatTexture, colourTexture, target });
})();
