//! What is served: the page, its files, and a few answers in JSON.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;

use super::desk::{Desk, Wish};
use crate::curation::review::ReviewError;
use crate::curation::review::assets::{ASSETS, PAGE};
use crate::web::{Asset, PALETTE, SHARED};

type Shared = Arc<Mutex<Desk>>;

/// Longest body of a request, bytes.
const LONGEST_BODY: usize = 64 * 1024;

/// The routes below the token.
pub(super) fn router(desk: Shared) -> Router {
    Router::new()
        .route("/{token}/", get(async || asset(&PAGE)))
        .route("/{token}/{file}", get(file))
        .route("/{token}/api/session", get(session))
        .route("/{token}/api/scenario/{index}", get(scenario))
        .route("/{token}/api/reviewer", post(reviewer))
        .route("/{token}/api/decide", post(decide))
        .route("/{token}/api/undo", post(undo))
        .with_state(desk)
        .layer(DefaultBodyLimit::max(LONGEST_BODY))
}

fn asset(asset: &'static Asset) -> Response {
    ([(header::CONTENT_TYPE, asset.kind)], asset.text).into_response()
}

async fn file(Path((_, name)): Path<(String, String)>) -> Response {
    match ASSETS.iter().chain(SHARED).chain([&PALETTE]).find(|a| a.name == name) {
        Some(found) => asset(found),
        None => (StatusCode::NOT_FOUND, "no such file\n").into_response(),
    }
}

/// Nobody else holds the desk: requests are answered one after another.
fn open(desk: &Shared) -> MutexGuard<'_, Desk> {
    desk.lock().unwrap_or_else(PoisonError::into_inner)
}

async fn session(State(desk): State<Shared>) -> Response {
    answer(open(&desk).session())
}

async fn scenario(State(desk): State<Shared>, Path((_, index)): Path<(String, usize)>) -> Response {
    match open(&desk).scenario(index) {
        Some(result) => answer(result),
        None => (StatusCode::NOT_FOUND, "no such scenario\n").into_response(),
    }
}

#[derive(Deserialize)]
struct Name {
    name: String,
}

async fn reviewer(State(desk): State<Shared>, Json(name): Json<Name>) -> Response {
    answer(open(&desk).set_reviewer(&name.name))
}

async fn decide(State(desk): State<Shared>, Json(wish): Json<Wish>) -> Response {
    answer(open(&desk).decide(wish))
}

async fn undo(State(desk): State<Shared>) -> Response {
    answer(open(&desk).undo())
}

/// JSON, or why there is none, in words for the page.
fn answer(result: Result<String, ReviewError>) -> Response {
    match result {
        Ok(json) => ([(header::CONTENT_TYPE, "application/json")], json).into_response(),
        Err(error) => {
            let status = match error {
                ReviewError::Decision { .. } | ReviewError::Reviewer { .. } => {
                    StatusCode::UNPROCESSABLE_ENTITY
                }
                _ => StatusCode::INTERNAL_SERVER_ERROR,
            };
            (status, error.to_string()).into_response()
        }
    }
}
