//! Server of the page with every scene, on the loopback interface.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use axum::Router;
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use parking_lot::Mutex;

use super::PageError;
use super::gallery::Gallery;
use crate::web::{Loopback, Site, Stop};

/// Number of cached scenes at which the cache is cleared.
const MAX_CACHED_SCENES: usize = 64;

/// State of the server.
struct PageState {
    gallery: Gallery,
    page: String,
    scenes: Mutex<BTreeMap<usize, String>>,
}

impl Gallery {
    /// Serves the page to this machine until `stop` is triggered. Scenes are created on request.
    ///
    /// # Errors
    /// [`PageError`] if the page cannot be created or the port is lost.
    pub fn serve(self, loopback: Loopback, stop: &Stop) -> Result<(), PageError> {
        let drawn: BTreeSet<usize> = (0..self.scenarios.len()).filter(|&i| self.has_scene(i)).collect();
        let document = self.document(&drawn, true, "")?;
        let state = PageState { gallery: self, page: document.text, scenes: Mutex::default() };
        let router = Router::new()
            .route("/{token}/", get(page))
            .route("/{token}/scene/{index}", get(scene))
            .with_state(Arc::new(state));
        let site = Site {
            hint: "open the address that `reactsim view` printed",
            policy: format!("{}; frame-ancestors 'none'", document.policy),
        };
        Ok(loopback.run(router, site, stop)?)
    }
}

async fn page(State(state): State<Arc<PageState>>) -> Response {
    ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], state.page.clone()).into_response()
}

async fn scene(State(state): State<Arc<PageState>>, Path((_, index)): Path<(String, usize)>) -> Response {
    match state.scene(index) {
        Ok(Some(json)) => ([(header::CONTENT_TYPE, "application/json")], json).into_response(),
        Ok(None) => (StatusCode::NOT_FOUND, "there is no such scene\n").into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

impl PageState {
    fn scene(&self, index: usize) -> Result<Option<String>, PageError> {
        let mut scenes = self.scenes.lock();
        if let Some(json) = scenes.get(&index) {
            return Ok(Some(json.clone()));
        }
        let Some(json) = self.gallery.scene(index)? else { return Ok(None) };
        if scenes.len() >= MAX_CACHED_SCENES {
            scenes.clear();
        }
        scenes.insert(index, json.clone());
        Ok(Some(json))
    }
}
