// What the page holds in compressed form.

import { decodeBytes } from "./answer.js";

const stream = (text) => new Blob([decodeBytes(text)]).stream().pipeThrough(new DecompressionStream("deflate"));

/** The text in what the compiler has written as base64 of its compressed bytes. */
export const inflatedText = (packed) => new Response(stream(packed)).text();

/** The bytes in it. */
export const inflatedBytes = (packed) => new Response(stream(packed)).arrayBuffer();
