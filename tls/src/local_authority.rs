//! A certificate authority for tests and local networks, and a server's certificate that it signs.

use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DistinguishedName, DnType,
    ExtendedKeyUsagePurpose, IsCa, KeyPair, KeyUsagePurpose,
};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use zk0_files::atomic_file;

/// The authority's certificate. Clients trust it.
pub const CA: &str = "ca.pem";
/// The authority's key. Whoever has it can sign a certificate for any name.
pub const CA_KEY: &str = "ca.key";
/// The server's certificate.
pub const CERTIFICATE: &str = "server.pem";
/// The server's key.
pub const KEY: &str = "server.key";

/// Why there is no certificate.
#[derive(Debug, thiserror::Error)]
pub enum AuthorityError {
    /// A file is there already.
    #[error("{} exists, and nothing is overwritten: choose an empty folder", .0.display())]
    Exists(PathBuf),
    /// A file cannot be written.
    #[error("writing {}: {error}", .path.display())]
    Write { path: PathBuf, error: io::Error },
    /// A name cannot stand in a certificate.
    #[error("no certificate can be made for the names {names:?}: {error}")]
    Names {
        names: Vec<String>,
        error: rcgen::Error,
    },
}

/// An authority and what it has signed, as PEM.
pub struct LocalAuthority {
    /// The authority's certificate.
    pub ca: String,
    ca_key: String,
    /// The server's certificate.
    pub certificate: String,
    /// The server's key.
    pub key: String,
}

impl LocalAuthority {
    /// A new authority, and a certificate for a server with these host names and IP addresses.
    pub fn new(names: &[String]) -> Result<Self, AuthorityError> {
        Self::with(names, |_| {})
    }

    /// Like [`Self::new`], and `change` changes the server's certificate before it is signed.
    pub fn with(
        names: &[String],
        change: impl FnOnce(&mut CertificateParams),
    ) -> Result<Self, AuthorityError> {
        Self::make(names, change).map_err(|error| AuthorityError::Names {
            names: names.to_vec(),
            error,
        })
    }

    fn make(
        names: &[String],
        change: impl FnOnce(&mut CertificateParams),
    ) -> Result<Self, rcgen::Error> {
        let mut params = CertificateParams::default();
        params.distinguished_name = named("zk0 local authority");
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        let authority = CertifiedIssuer::self_signed(params, KeyPair::generate()?)?;

        let key = KeyPair::generate()?;
        let mut params = CertificateParams::new(names)?;
        params.distinguished_name = named(names.first().map_or("zk0", String::as_str));
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
        params.use_authority_key_identifier_extension = true;
        change(&mut params);
        let certificate = params.signed_by(&key, &authority)?;
        Ok(Self {
            ca: authority.pem(),
            ca_key: authority.key().serialize_pem(),
            certificate: certificate.pem(),
            key: key.serialize_pem(),
        })
    }

    /// Writes the four files into a folder that has none of them. Their owner alone can read the keys.
    pub fn write(&self, dir: &Path) -> Result<(), AuthorityError> {
        let written = |path: &Path, result: io::Result<()>| {
            result.map_err(|error| AuthorityError::Write {
                path: path.into(),
                error,
            })
        };
        written(dir, fs::create_dir_all(dir))?;
        let files = [
            (CA, &self.ca, 0o644),
            (CA_KEY, &self.ca_key, 0o600),
            (CERTIFICATE, &self.certificate, 0o644),
            (KEY, &self.key, 0o600),
        ];
        let paths = files.map(|(name, ..)| dir.join(name));
        if let Some(there) = paths.iter().find(|path| path.exists()) {
            return Err(AuthorityError::Exists(there.clone()));
        }
        for (path, (_, text, mode)) in paths.iter().zip(files) {
            written(path, create(path, text, mode))?;
        }
        written(dir, atomic_file::sync_folder(dir))
    }
}

fn create(path: &Path, text: &str, mode: u32) -> io::Result<()> {
    use std::io::Write;
    use std::os::unix::fs::OpenOptionsExt;
    let mut file = fs::OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(mode)
        .open(path)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()
}

fn named(name: &str) -> DistinguishedName {
    let mut named = DistinguishedName::new();
    named.push(DnType::CommonName, name);
    named
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn keys_are_for_their_owner_alone_and_nothing_is_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        let authority = LocalAuthority::new(&["localhost".into()]).unwrap();
        authority.write(dir.path()).unwrap();
        for name in [CA_KEY, KEY] {
            let mode = fs::metadata(dir.path().join(name)).unwrap().permissions();
            assert_eq!(mode.mode() & 0o777, 0o600, "{name}");
        }
        let another = LocalAuthority::new(&["localhost".into()]).unwrap();
        let error = another.write(dir.path()).unwrap_err();
        assert!(matches!(error, AuthorityError::Exists(_)), "{error}");
        let kept = fs::read_to_string(dir.path().join(CA)).unwrap();
        assert_eq!(kept, authority.ca);
    }
}
