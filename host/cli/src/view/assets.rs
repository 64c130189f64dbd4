//! The files of the page. It loads nothing from elsewhere.

use super::http;
use std::net::TcpStream;

/// A file of the page.
pub struct Asset {
    path: &'static str,
    kind: &'static str,
    text: &'static str,
}

/// The page's own script, one idea per file.
const SCRIPT: &str = concat!(
    "\"use strict\";\n",
    include_str!("page/words.js"),
    include_str!("page/sensor.js"),
    include_str!("page/noise.js"),
    include_str!("page/develop.js"),
    include_str!("page/picture.js"),
    include_str!("page/plots.js"),
    include_str!("page/events.js"),
    include_str!("page/controls.js"),
    include_str!("page/link.js"),
    include_str!("page/console.js"),
);

const ASSETS: [Asset; 5] = [
    Asset { path: "/", kind: "text/html", text: include_str!("page/console.html") },
    Asset { path: "/console.css", kind: "text/css", text: include_str!("page/console.css") },
    Asset { path: "/console.js", kind: "text/javascript", text: SCRIPT },
    Asset { path: "/uPlot.css", kind: "text/css", text: include_str!("vendor/uPlot.css") },
    Asset {
        path: "/uPlot.js",
        kind: "text/javascript",
        text: include_str!("vendor/uPlot.iife.min.js"),
    },
];

/// The file at a path.
pub fn find(path: &str) -> Option<&'static Asset> {
    ASSETS.iter().find(|asset| asset.path == path)
}

impl Asset {
    /// Sends it to a page at `host`.
    ///
    /// # Errors
    /// A client that has disconnected.
    pub fn send(&self, stream: &mut TcpStream, host: &str) -> std::io::Result<()> {
        let kind = format!("{}; charset=utf-8", self.kind);
        http::send(stream, 200, &kind, &format!("ws://{host}"), self.text.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sha2::{Digest, Sha256};

    #[test]
    fn what_is_vendored_is_what_its_readme_says() {
        let readme = include_str!("vendor/README.md");
        for (name, text) in [
            ("uPlot.iife.min.js", include_str!("vendor/uPlot.iife.min.js")),
            ("uPlot.css", include_str!("vendor/uPlot.css")),
        ] {
            let digest = Sha256::digest(text);
            let digest: String = digest.iter().map(|b| format!("{b:02x}")).collect();
            let line = readme.lines().find(|line| line.starts_with(&format!("| `{name}`")));
            assert!(line.unwrap().contains(&digest), "{name} has {digest}");
        }
    }

    #[test]
    fn the_page_is_small_and_asks_nothing_of_a_network() {
        let bytes: usize = ASSETS.iter().map(|asset| asset.text.len()).sum();
        assert!(bytes < 200_000, "{bytes}");
        let own = ASSETS.iter().filter(|asset| !asset.path.contains("uPlot"));
        for asset in own {
            assert!(!asset.text.contains("://") || asset.path == "/console.js", "{}", asset.path);
        }
        assert_eq!(SCRIPT.matches("://").count(), 1, "the WebSocket's address");
    }
}
