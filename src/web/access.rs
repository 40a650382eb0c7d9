//! Who may ask for something: the token, and pages of the same origin only.
//!
//! The token stands in a header of its own, so a form of another site cannot send it, no address
//! with it is ever logged, and a browser asks before it lets another origin set it, which this
//! server never allows. Origin and `Sec-Fetch-Site` are looked at all the same, and `Host` must be
//! an address, `localhost` or a configured name: a name that another site points here is refused.

use axum::http::header::{HOST, ORIGIN};
use axum::http::{HeaderMap, StatusCode};
use std::fmt;
use std::net::IpAddr;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use subtle::ConstantTimeEq as _;

/// The header of the token.
pub(super) const TOKEN_HEADER: &str = "x-stockpilot-token";
/// Shorter ones could be guessed.
const MIN_TOKEN_CHARS: usize = 16;
/// Permission bits of group and others.
const OTHERS: u32 = 0o077;

/// What opens the controls; never printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(secret)")
    }
}

/// Why there is no token.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The file cannot be read.
    #[error("cannot read the page's token {path}: {source}", path = path.display())]
    Unreadable {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Others than the owner may read it.
    #[error("the page's token {path} has mode {mode:03o}: take it from others with `chmod 600`", path = path.display())]
    Shared {
        /// Which file.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// It could be guessed, or cannot stand in a header.
    #[error("the page's token {path} needs {MIN_TOKEN_CHARS} or more visible characters, as `openssl rand -hex 16` makes them", path = path.display())]
    Weak {
        /// Which file.
        path: PathBuf,
    },
}

impl Token {
    /// Reads a token file.
    ///
    /// # Errors
    /// See [`TokenError`].
    pub fn read(path: &Path) -> Result<Self, TokenError> {
        let unreadable = |source| TokenError::Unreadable { path: path.to_owned(), source };
        let mode = std::fs::metadata(path).map_err(unreadable)?.permissions().mode() & 0o777;
        if mode & OTHERS != 0 {
            return Err(TokenError::Shared { path: path.to_owned(), mode });
        }
        let text = std::fs::read_to_string(path).map_err(unreadable)?;
        let token = text.trim();
        let is_strong =
            token.len() >= MIN_TOKEN_CHARS && token.bytes().all(|c| c.is_ascii_graphic());
        is_strong
            .then(|| Self(token.to_owned()))
            .ok_or_else(|| TokenError::Weak { path: path.to_owned() })
    }

    fn is(&self, shown: &[u8]) -> bool {
        self.0.as_bytes().ct_eq(shown).into()
    }
}

/// Why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    #[error("this page is called by a name that it does not know: use its address")]
    UnknownHost,
    #[error("only the own page may ask for this")]
    ForeignOrigin,
    #[error("this service has no token: it can only be looked at")]
    NoToken,
    #[error("the token is missing or wrong")]
    WrongToken,
}

impl Refusal {
    pub(super) const fn status(self) -> StatusCode {
        match self {
            Self::UnknownHost => StatusCode::MISDIRECTED_REQUEST,
            Self::ForeignOrigin | Self::NoToken => StatusCode::FORBIDDEN,
            Self::WrongToken => StatusCode::UNAUTHORIZED,
        }
    }
}

/// Judges requests by their headers.
#[derive(Debug, Clone)]
pub(super) struct Access {
    pub(super) token: Option<Token>,
    pub(super) host_names: Vec<String>,
}

impl Access {
    /// What everybody must keep who wants to look.
    pub(super) fn may_look(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let host = text(headers, HOST.as_str()).ok_or(Refusal::UnknownHost)?;
        if !self.is_own_host(host) {
            return Err(Refusal::UnknownHost);
        }
        // Browsers name the origin with everything but plain reading; programs do not at all.
        let is_own = |origin: &str| origin_host(origin) == Some(host);
        if headers.contains_key(ORIGIN) && !text(headers, ORIGIN.as_str()).is_some_and(is_own) {
            return Err(Refusal::ForeignOrigin);
        }
        Ok(())
    }

    /// What is needed beside [`Self::may_look`] to ask for something.
    pub(super) fn may_ask(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        self.may_look(headers)?;
        let site = text(headers, "sec-fetch-site");
        if site.is_some_and(|site| site != "same-origin") {
            return Err(Refusal::ForeignOrigin);
        }
        let token = self.token.as_ref().ok_or(Refusal::NoToken)?;
        let shown = headers.get(TOKEN_HEADER).ok_or(Refusal::WrongToken)?;
        if token.is(shown.as_bytes()) { Ok(()) } else { Err(Refusal::WrongToken) }
    }

    fn is_own_host(&self, host: &str) -> bool {
        let name = host_name(host);
        name.parse::<IpAddr>().is_ok()
            || name.eq_ignore_ascii_case("localhost")
            || self.host_names.iter().any(|known| known.eq_ignore_ascii_case(name))
    }
}

fn text<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name)?.to_str().ok()
}

/// `http://10.0.0.2:8080` to `10.0.0.2:8080`.
fn origin_host(origin: &str) -> Option<&str> {
    origin.split_once("://").map(|(_, host)| host)
}

/// The host without its port and without the brackets of IPv6.
fn host_name(host: &str) -> &str {
    if let Some((name, _)) = host.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        return name;
    }
    host.rsplit_once(':').map_or(host, |(name, _)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn access() -> Access {
        Access {
            token: Some(Token("0123456789abcdef".to_owned())),
            host_names: vec!["hall.local".to_owned()],
        }
    }

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap())).collect()
    }

    #[test]
    fn looking_needs_an_own_name_and_no_foreign_origin() {
        for (host, origin, is_allowed) in [
            ("127.0.0.1:8080", None, true),
            ("[::1]:8080", None, true),
            ("HALL.local", Some("http://HALL.local"), true),
            ("hall.local:8080", Some("http://hall.local:8080"), true),
            ("localhost:9", None, true),
            // A name of somebody else that points here.
            ("evil.example:8080", None, false),
            ("127.0.0.1:8080", Some("http://evil.example"), false),
            ("127.0.0.1:8080", Some("null"), false),
            // Another port is another origin.
            ("127.0.0.1:8080", Some("http://127.0.0.1:9090"), false),
        ] {
            let mut pairs = vec![("host", host)];
            pairs.extend(origin.map(|origin| ("origin", origin)));
            assert_eq!(access().may_look(&headers(&pairs)).is_ok(), is_allowed, "{pairs:?}");
        }
        assert_eq!(access().may_look(&headers(&[])), Err(Refusal::UnknownHost));
    }

    #[test]
    fn asking_needs_the_token_from_the_own_page() {
        let host = ("host", "127.0.0.1:8080");
        let token = (TOKEN_HEADER, "0123456789abcdef");
        let ask = |pairs: &[_]| access().may_ask(&headers(pairs));
        assert_eq!(ask(&[host, token]), Ok(()));
        assert_eq!(ask(&[host, token, ("sec-fetch-site", "same-origin")]), Ok(()));
        assert_eq!(ask(&[host]), Err(Refusal::WrongToken));
        assert_eq!(ask(&[host, (TOKEN_HEADER, "0123456789abcdeX")]), Err(Refusal::WrongToken));
        assert_eq!(ask(&[host, (TOKEN_HEADER, "0123456789abcde")]), Err(Refusal::WrongToken));
        let cross = [host, token, ("sec-fetch-site", "cross-site")];
        assert_eq!(ask(&cross), Err(Refusal::ForeignOrigin));
        let evil = [host, token, ("origin", "http://evil.example")];
        assert_eq!(ask(&evil), Err(Refusal::ForeignOrigin));
        let closed = Access { token: None, ..access() };
        assert_eq!(closed.may_ask(&headers(&[host, token])), Err(Refusal::NoToken));
    }

    #[test]
    fn token_files_are_secret_and_long_enough() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("token");
        let write = |text: &str, mode: u32| {
            std::fs::write(&path, text).unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
            Token::read(&path)
        };
        assert!(write("0123456789abcdef\n", 0o600).is_ok());
        assert!(matches!(write("0123456789abcdef", 0o640), Err(TokenError::Shared { .. })));
        assert!(matches!(write("0123456789abcde", 0o600), Err(TokenError::Weak { .. })));
        assert!(matches!(write("0123456789 abcdef", 0o600), Err(TokenError::Weak { .. })));
        assert_eq!(format!("{:?}", write("0123456789abcdef", 0o600).unwrap()), "Token(secret)");
    }
}
