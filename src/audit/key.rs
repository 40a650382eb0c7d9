//! The key that signs packs, in minisign's own form.

use super::{AuditError, at, minisign_error};
use minisign::{KeyPair, PublicKey, PublicKeyBox, SecretKey, SecretKeyBox};
use std::fs::OpenOptions;
use std::io::Write as _;
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

/// Permission bits of group and others.
const OTHERS: u32 = 0o077;

/// A secret key with its public half; never printed.
pub struct AuditKey {
    pub(super) secret: SecretKey,
    pub(super) public: PublicKey,
}

impl std::fmt::Debug for AuditKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("AuditKey").field("public", &self.public.to_base64()).finish_non_exhaustive()
    }
}

/// Makes a key: `path` for the secret half (mode 600, not protected by a password), `path` with the
/// ending `.pub` for the public one, whose path it gives. Neither file may exist.
///
/// # Errors
/// Files that exist or cannot be written, or a machine without random numbers.
pub fn make_key(path: &Path) -> Result<PathBuf, AuditError> {
    let pair = KeyPair::generate_unencrypted_keypair().map_err(minisign_error("making a key"))?;
    let secret = pair
        .sk
        .to_box(Some("stockpilot audit key: keep it secret"))
        .map_err(minisign_error("making a key"))?;
    let public_path = path.with_extension("pub");
    write_new(&public_path, &boxed(&pair.pk)?, 0o644)?;
    write_new(path, &secret.into_string(), 0o600).inspect_err(|_| {
        // A public half without a secret one is of no use.
        let _gone = std::fs::remove_file(&public_path);
    })?;
    Ok(public_path)
}

/// The public half as a file holds it.
pub(super) fn boxed(public: &PublicKey) -> Result<String, AuditError> {
    let boxed = public.to_box().map_err(minisign_error("writing the public key"))?;
    Ok(boxed.into_string())
}

fn write_new(path: &Path, text: &str, mode: u32) -> Result<(), AuditError> {
    let mut file =
        OpenOptions::new().write(true).create_new(true).mode(mode).open(path).map_err(at(path))?;
    file.write_all(text.as_bytes()).map_err(at(path))?;
    if !text.ends_with('\n') {
        file.write_all(b"\n").map_err(at(path))?;
    }
    file.sync_all().map_err(at(path))
}

impl AuditKey {
    /// Reads a secret key.
    ///
    /// # Errors
    /// A file that cannot be read, is no key, or that others may read.
    pub fn read(path: &Path) -> Result<Self, AuditError> {
        let mode = std::fs::metadata(path).map_err(at(path))?.permissions().mode() & 0o777;
        if mode & OTHERS != 0 {
            return Err(AuditError::SharedKey { path: path.to_owned(), mode });
        }
        let text = std::fs::read_to_string(path).map_err(at(path))?;
        let what = || format!("{} is no key", path.display());
        let secret = SecretKeyBox::from_string(&text)
            .and_then(SecretKeyBox::into_unencrypted_secret_key)
            .map_err(minisign_error(what()))?;
        let public = PublicKey::from_secret_key(&secret).map_err(minisign_error(what()))?;
        Ok(Self { secret, public })
    }
}

impl AuditKey {
    /// The public half.
    #[must_use]
    pub const fn public(&self) -> &PublicKey {
        &self.public
    }

    /// Signs the list of a pack's files, as minisign does.
    ///
    /// # Errors
    /// A machine without random numbers.
    pub fn sign(&self, list: &[u8], comment: &str) -> Result<String, AuditError> {
        let untrusted = Some("minisign signature of SHA256SUMS");
        minisign::sign(Some(&self.public), &self.secret, list, Some(comment), untrusted)
            .map(minisign::SignatureBox::into_string)
            .map_err(minisign_error("signing"))
    }
}

/// Reads a public key.
///
/// # Errors
/// A file that cannot be read or is no key.
pub fn read_public_key(path: &Path) -> Result<PublicKey, AuditError> {
    let text = std::fs::read_to_string(path).map_err(at(path))?;
    PublicKeyBox::from_string(text.trim_end())
        .and_then(PublicKeyBox::into_public_key)
        .map_err(minisign_error(format!("{} is no public key", path.display())))
}
