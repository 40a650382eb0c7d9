//! The page itself: every file is part of the program.

use axum::http::StatusCode;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};

const HTML: &str = "text/html; charset=utf-8";
const JS: &str = "text/javascript; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const TEXT: &str = "text/plain; charset=utf-8";
const SVG: &str = "image/svg+xml";

/// Path, type, content.
const FILES: &[(&str, &str, &str)] = &[
    ("/", HTML, include_str!("page/index.html")),
    ("/page.css", CSS, include_str!("page/page.css")),
    ("/icon.svg", SVG, include_str!("page/icon.svg")),
    ("/page.js", JS, include_str!("page/page.js")),
    ("/live.js", JS, include_str!("page/live.js")),
    ("/controls.js", JS, include_str!("page/controls.js")),
    ("/colours.js", JS, include_str!("page/colours.js")),
    ("/map.js", JS, include_str!("page/map.js")),
    ("/chart.js", JS, include_str!("page/chart.js")),
    ("/surface.js", JS, include_str!("page/surface.js")),
    ("/vendor/uPlot.esm.js", JS, include_str!("page/vendor/uplot/uPlot.esm.js")),
    ("/vendor/uPlot.min.css", CSS, include_str!("page/vendor/uplot/uPlot.min.css")),
    ("/vendor/uPlot.LICENSE", TEXT, include_str!("page/vendor/uplot/LICENSE")),
    ("/vendor/three.module.min.js", JS, include_str!("page/vendor/three/three.module.min.js")),
    ("/vendor/three.core.min.js", JS, include_str!("page/vendor/three/three.core.min.js")),
    ("/vendor/OrbitControls.js", JS, include_str!("page/vendor/three/OrbitControls.js")),
    ("/vendor/three.LICENSE", TEXT, include_str!("page/vendor/three/LICENSE")),
];

/// A file of the page.
pub(super) fn file(path: &str) -> Response {
    match FILES.iter().find(|(name, ..)| *name == path) {
        // A new program has new files: nothing is kept for longer than a reload.
        Some((_, kind, content)) => {
            ([(CONTENT_TYPE, *kind), (CACHE_CONTROL, "no-cache")], *content).into_response()
        }
        None => (StatusCode::NOT_FOUND, "there is nothing here").into_response(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_needs_nothing_from_elsewhere() {
        for (name, kind, content) in FILES.iter().filter(|(name, ..)| !name.contains("vendor")) {
            for far in ["src=\"http", "href=\"http", "url(http", "from 'http", "//cdn", "@import"] {
                assert!(!content.contains(far), "{name} ({kind}) asks for {far}");
            }
            // What a module imports must be served.
            for import in content.lines().filter_map(|line| line.split(" from '").nth(1)) {
                let path = import.split('\'').next().unwrap_or_default();
                let path = path.trim_start_matches('.');
                let is_mapped = path == "three";
                assert!(is_mapped || file(path).status() == StatusCode::OK, "{name}: {path}");
            }
        }
    }
}
