//! The routes: the page, its files, and a few JSON endpoints.

use std::sync::Arc;

use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use parking_lot::{Mutex, MutexGuard};
use reactsim_web::{Asset, PALETTE, SHARED};
use serde::Deserialize;

use super::state::{DecisionRequest, ReviewState};
use crate::review::ReviewError;
use crate::review::assets::{ASSETS, PAGE};

type Shared = Arc<Mutex<ReviewState>>;

/// Largest size of a request body, bytes.
const MAX_BODY_BYTES: usize = 64 * 1024;

/// Returns the routes below the token.
pub(super) fn router(review: Shared) -> Router {
    Router::new()
        .route("/{token}/", get(async || asset(&PAGE)))
        .route("/{token}/{file}", get(file))
        .route("/{token}/api/session", get(session))
        .route("/{token}/api/scenario/{index}", get(scenario))
        .route("/{token}/api/reviewer", post(reviewer))
        .route("/{token}/api/decide", post(decide))
        .route("/{token}/api/undo", post(undo))
        .with_state(review)
        .layer(DefaultBodyLimit::max(MAX_BODY_BYTES))
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

/// Locks the state: requests are answered one after another.
fn open(review: &Shared) -> MutexGuard<'_, ReviewState> {
    review.lock()
}

async fn session(State(review): State<Shared>) -> Response {
    answer(open(&review).session())
}

async fn scenario(State(review): State<Shared>, Path((_, index)): Path<(String, usize)>) -> Response {
    match open(&review).scenario(index) {
        Some(result) => answer(result),
        None => (StatusCode::NOT_FOUND, "no such scenario\n").into_response(),
    }
}

#[derive(Deserialize)]
struct Name {
    name: String,
}

async fn reviewer(State(review): State<Shared>, Json(name): Json<Name>) -> Response {
    answer(open(&review).set_reviewer(&name.name))
}

async fn decide(State(review): State<Shared>, Json(request): Json<DecisionRequest>) -> Response {
    answer(open(&review).decide(request))
}

async fn undo(State(review): State<Shared>) -> Response {
    answer(open(&review).undo())
}

/// Returns the response: JSON, or an error message for the page.
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
