//! Settings of a site.

/// Settings of a site.
#[derive(Clone, Debug)]
pub struct Site {
    /// Hint for requests without the token: how to find the address.
    pub hint: &'static str,
    /// Content security policy of the page (`Content-Security-Policy`).
    pub policy: String,
}
