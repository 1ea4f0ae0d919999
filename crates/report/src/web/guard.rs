//! Access control: answers only requests with the token that come from a page of this server.

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::server::Site;

/// Criteria that every request must meet.
#[derive(Clone)]
pub(super) struct Guard {
    token: blake3::Hash,
    hosts: [String; 2],
    site: Site,
}

impl Guard {
    pub(super) fn new(token: &str, port: u16, site: &Site) -> Self {
        Self {
            token: blake3::hash(token.as_bytes()),
            hosts: [format!("127.0.0.1:{port}"), format!("localhost:{port}")],
            site: site.clone(),
        }
    }

    /// Returns whether the request is addressed to this server and comes from no other origin. Refuses
    /// foreign host names that resolve to this machine (DNS rebinding).
    fn is_ours(&self, headers: &HeaderMap) -> bool {
        let known = |value: &HeaderValue, scheme: &str| {
            let host = value.to_str().ok().and_then(|v| v.strip_prefix(scheme));
            host.is_some_and(|host| self.hosts.iter().any(|h| h == host))
        };
        // Refuse requests with several host headers.
        let mut hosts = headers.get_all(header::HOST).iter();
        let one = hosts.next().is_some_and(|host| known(host, "")) && hosts.next().is_none();
        one && headers.get_all(header::ORIGIN).iter().all(|origin| known(origin, "http://"))
    }

    /// Returns whether the path begins with the token. Compares digests, in constant time.
    fn has_token(&self, path: &str) -> bool {
        let first = path.strip_prefix('/').and_then(|rest| rest.split_once('/')).map(|(first, _)| first);
        first.is_some_and(|first| blake3::hash(first.as_bytes()) == self.token)
    }
}

/// Headers of every response, apart from the content security policy: no caching, no referrer.
const HEADERS: [(HeaderName, &str); 5] = [
    (header::CACHE_CONTROL, "no-store"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Passes permitted requests on and refuses the others.
pub(super) async fn guard(State(guard): State<Guard>, request: Request, next: Next) -> Response {
    let mut response = if !guard.is_ours(request.headers()) {
        (StatusCode::FORBIDDEN, "this server answers only its own page\n").into_response()
    } else if !guard.has_token(request.uri().path()) {
        (StatusCode::NOT_FOUND, format!("not found: {}\n", guard.site.hint)).into_response()
    } else {
        next.run(request).await
    };
    let headers = response.headers_mut();
    for (name, value) in HEADERS {
        headers.insert(name, HeaderValue::from_static(value));
    }
    // An invalid policy header must not allow everything: fall back to allowing nothing.
    let policy = HeaderValue::from_str(&guard.site.policy);
    headers.insert(
        header::CONTENT_SECURITY_POLICY,
        policy.unwrap_or_else(|_| HeaderValue::from_static("default-src 'none'")),
    );
    response
}
