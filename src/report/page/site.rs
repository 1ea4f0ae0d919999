//! The page on the loopback interface, with every scene.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

use axum::Router;
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;

use super::PageError;
use super::gallery::Gallery;
use crate::web::{Loopback, Site, Stop};

/// Scenes that are kept before all are forgotten.
const KEPT: usize = 64;

struct Desk {
    gallery: Gallery,
    page: String,
    scenes: Mutex<BTreeMap<usize, String>>,
}

impl Gallery {
    /// Shows the page to this machine until `stop` is asked for. Scenes are made when they are asked for.
    ///
    /// # Errors
    /// [`PageError`] when the page can not be made or the port is lost.
    pub fn serve(self, loopback: Loopback, stop: &Stop) -> Result<(), PageError> {
        let drawn: BTreeSet<usize> = (0..self.scenarios.len()).filter(|&i| self.has_scene(i)).collect();
        let document = self.document(&drawn, true, "")?;
        let desk = Desk { gallery: self, page: document.text, scenes: Mutex::default() };
        let router = Router::new()
            .route("/{token}/", get(page))
            .route("/{token}/scene/{index}", get(scene))
            .with_state(Arc::new(desk));
        let site = Site {
            hint: "open the address that `reactsim view` printed",
            policy: format!("{}; frame-ancestors 'none'", document.policy),
        };
        Ok(loopback.run(router, site, stop)?)
    }
}

async fn page(State(desk): State<Arc<Desk>>) -> Response {
    ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], desk.page.clone()).into_response()
}

async fn scene(State(desk): State<Arc<Desk>>, Path((_, index)): Path<(String, usize)>) -> Response {
    match desk.scene(index) {
        Ok(Some(json)) => ([(header::CONTENT_TYPE, "application/json")], json).into_response(),
        Ok(None) => (StatusCode::NOT_FOUND, "there is no such scene\n").into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

impl Desk {
    fn scene(&self, index: usize) -> Result<Option<String>, PageError> {
        let mut scenes = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(json) = scenes.get(&index) {
            return Ok(Some(json.clone()));
        }
        let Some(json) = self.gallery.scene(index)? else { return Ok(None) };
        if scenes.len() >= KEPT {
            scenes.clear();
        }
        scenes.insert(index, json.clone());
        Ok(Some(json))
    }
}
