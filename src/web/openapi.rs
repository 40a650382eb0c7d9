//! The description of the interface.

use super::server::{AskDoc, LookDoc};
use utoipa::OpenApi;

/// The OpenAPI 3.1 document, JSON.
#[must_use]
pub fn openapi_json() -> String {
    let mut document = LookDoc::openapi();
    document.merge(AskDoc::openapi());
    document.info.title = "stockpilot".to_owned();
    document.info.version = env!("CARGO_PKG_VERSION").to_owned();
    document.info.description = Some(
        "Reading is free for who reaches the address. Asking needs the token in its header, from \
         the page's own origin or from a program that names none."
            .to_owned(),
    );
    document.to_json().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_route_is_described_and_nothing_else() {
        let document: serde_json::Value = serde_json::from_str(&openapi_json()).unwrap();
        assert!(document["openapi"].as_str().unwrap().starts_with("3.1"), "{document}");
        let described: BTreeSet<&str> =
            document["paths"].as_object().unwrap().keys().map(String::as_str).collect();
        let source = include_str!("server.rs");
        let routes: BTreeSet<&str> = source
            .lines()
            .filter_map(|line| line.trim().strip_prefix(".route(\"")?.split('"').next())
            .collect();
        assert!(routes.len() > 8);
        assert_eq!(described, routes);
        // Asking needs the token, looking does not.
        for (path, methods) in document["paths"].as_object().unwrap() {
            for (method, operation) in methods.as_object().unwrap() {
                let needs_token = operation["security"].is_array();
                assert_eq!(needs_token, method == "post", "{method} {path}");
            }
        }
    }
}
