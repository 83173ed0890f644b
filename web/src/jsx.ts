// What JSX becomes; see build.mjs. No name of the page is like these.
export { Fragment as _Fragment, h as _h } from "preact";
