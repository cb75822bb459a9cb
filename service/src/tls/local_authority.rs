//! A certificate authority for tests and local networks, and a server's certificate that it signs.

use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DistinguishedName, DnType,
    ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose, SigningKey,
};
use rustls::client::verify_server_cert_signed_by_trust_anchor;
use rustls::crypto::ring;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::server::ParsedCertificate;
use rustls::RootCertStore;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use zk0_files::{atomic_file, bounded_file};

/// The authority's certificate, which clients trust.
pub const CA: &str = "ca.pem";
/// The authority's key. It can sign a certificate for any name.
pub const CA_KEY: &str = "ca.key";
/// The server's certificate.
pub const CERTIFICATE: &str = "server.pem";
/// The server's key.
pub const KEY: &str = "server.key";

/// Largest file read of an authority.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// Why there is no certificate.
#[derive(Debug, thiserror::Error)]
pub enum AuthorityError {
    /// A file exists already.
    #[error("{} exists, and nothing is overwritten: choose an empty folder", .0.display())]
    Exists(PathBuf),
    /// An existing authority's file is unreadable.
    #[error("reading {}: {error}; the authority in this folder signs with it", .path.display())]
    Read { path: PathBuf, error: io::Error },
    /// The folder's files are no authority's.
    #[error("the authority in {} cannot sign: {why}", .dir.display())]
    NoAuthority { dir: PathBuf, why: String },
    /// A file cannot be written.
    #[error("writing {}: {error}", .path.display())]
    Write { path: PathBuf, error: io::Error },
    /// No client could use a certificate for this name.
    #[error("{0:?} is neither a host name nor an IP address: give a name by which clients reach the server, without a scheme and a port")]
    Name(String),
    /// A name that certificates cannot have.
    #[error("no certificate can be made for the names {names:?}: {error}")]
    Names {
        names: Vec<String>,
        error: rcgen::Error,
    },
}

/// An authority and its signed certificate, as PEM.
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
    /// A new authority, with a certificate for a server's host names and IP addresses.
    pub fn new(names: &[String]) -> Result<Self, AuthorityError> {
        Self::with(names, |_| {})
    }

    /// Like [`Self::new`]; `change` edits the server's certificate before signing.
    pub fn with(
        names: &[String],
        change: impl FnOnce(&mut CertificateParams),
    ) -> Result<Self, AuthorityError> {
        check_names(names)?;
        Self::make(names, change).map_err(|error| AuthorityError::Names {
            names: names.to_vec(),
            error,
        })
    }

    /// Signs a new server certificate with the authority in `dir`, and replaces the server's certificate and key there. Clients still
    /// believe the authority.
    ///
    /// # Errors
    /// `ca.pem` or `ca.key` is missing or damaged, or they do not belong together. Then nothing is written.
    pub fn sign_again(dir: &Path, names: &[String]) -> Result<(), AuthorityError> {
        check_names(names)?;
        let read = |name: &str| {
            let path = dir.join(name);
            let bytes = bounded_file::read(&path, MAX_FILE_BYTES);
            let text = bytes.and_then(|bytes| String::from_utf8(bytes).map_err(io::Error::other));
            text.map_err(|error| AuthorityError::Read { path, error })
        };
        let (ca, ca_key) = (read(CA)?, read(CA_KEY)?);
        let refused = |why: String| AuthorityError::NoAuthority {
            dir: dir.into(),
            why,
        };
        let ca_key = KeyPair::from_pem(&ca_key)
            .map_err(|error| refused(format!("{CA_KEY} holds no private key ({error})")))?;
        let authority = Issuer::new(authority_params(), ca_key);
        let (certificate, key) = server_certificate(names, &authority, |_| {})
            .map_err(|error| refused(error.to_string()))?;
        if !is_signed_by(&certificate, &ca) {
            let why = format!("{CA_KEY} is not the key of {CA}, or another program made them");
            return Err(refused(why));
        }
        let written = |name: &str, put: fn(&Path, &[u8]) -> io::Result<()>, text: &str| {
            let path = dir.join(name);
            put(&path, text.as_bytes()).map_err(|error| AuthorityError::Write { path, error })
        };
        written(KEY, atomic_file::replace_private, &key)?;
        written(CERTIFICATE, atomic_file::replace, &certificate)
    }

    fn make(
        names: &[String],
        change: impl FnOnce(&mut CertificateParams),
    ) -> Result<Self, rcgen::Error> {
        let authority = CertifiedIssuer::self_signed(authority_params(), KeyPair::generate()?)?;
        let (certificate, key) = server_certificate(names, &authority, change)?;
        Ok(Self {
            ca: authority.pem(),
            ca_key: authority.key().serialize_pem(),
            certificate,
            key,
        })
    }

    /// Writes the four files into a folder that has none of them. Only the owner can read the keys.
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

/// What all this program's authorities share: all but the key.
fn authority_params() -> CertificateParams {
    let mut params = CertificateParams::default();
    params.distinguished_name = named("zk0 local authority");
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    params
}

/// A server's certificate for these names and its key, as PEM.
fn server_certificate(
    names: &[String],
    authority: &Issuer<'_, impl SigningKey>,
    change: impl FnOnce(&mut CertificateParams),
) -> Result<(String, String), rcgen::Error> {
    let key = KeyPair::generate()?;
    let mut params = CertificateParams::new(names)?;
    params.distinguished_name = named(names.first().map_or("zk0", String::as_str));
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
    params.use_authority_key_identifier_extension = true;
    change(&mut params);
    let certificate = params.signed_by(&key, authority)?;
    Ok((certificate.pem(), key.serialize_pem()))
}

/// Whether a client that believes certificate `authority` now believes certificate `signed`. Both are PEM.
fn is_signed_by(signed: &str, authority: &str) -> bool {
    let der = |pem: &str| CertificateDer::from_pem_slice(pem.as_bytes()).ok();
    let (Some(signed), Some(authority)) = (der(signed), der(authority)) else {
        return false;
    };
    let mut roots = RootCertStore::empty();
    let parsed = ParsedCertificate::try_from(&signed);
    let (Ok(()), Ok(parsed)) = (roots.add(authority), parsed) else {
        return false;
    };
    let algorithms = ring::default_provider().signature_verification_algorithms;
    verify_server_cert_signed_by_trust_anchor(&parsed, &roots, &[], UnixTime::now(), algorithms.all)
        .is_ok()
}

fn check_names(names: &[String]) -> Result<(), AuthorityError> {
    match names.iter().find(|name| !is_server_name(name)) {
        Some(unusable) => Err(AuthorityError::Name(unusable.clone())),
        None => Ok(()),
    }
}

/// Whether a certificate can have this name. `*.` before a host name means all hosts of a domain.
fn is_server_name(name: &str) -> bool {
    let host = name.strip_prefix("*.").unwrap_or(name);
    match ServerName::try_from(host) {
        // Clients may ask for a host with a final dot, but no certificate may name it.
        Ok(ServerName::DnsName(_)) => !host.ends_with('.'),
        Ok(_) => host == name,
        Err(_) => false,
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

    #[test]
    fn an_authority_signs_again() {
        let dir = tempfile::tempdir().unwrap();
        let text = |name: &str| fs::read_to_string(dir.path().join(name)).unwrap();
        LocalAuthority::new(&["localhost".into()])
            .unwrap()
            .write(dir.path())
            .unwrap();
        let before = [CA, CA_KEY, CERTIFICATE, KEY].map(text);
        LocalAuthority::sign_again(dir.path(), &["192.0.2.7".into()]).unwrap();
        let after = [CA, CA_KEY, CERTIFICATE, KEY].map(text);
        assert_eq!(before[..2], after[..2]);
        assert_ne!(before[2], after[2]);
        assert!(is_signed_by(&after[2], &after[0]));
        let mode = fs::metadata(dir.path().join(KEY)).unwrap().permissions();
        assert_eq!(mode.mode() & 0o777, 0o600);
        // Another authority's key signs nothing, and nothing is written.
        let other = LocalAuthority::new(&["localhost".into()]).unwrap();
        fs::write(dir.path().join(CA_KEY), other.ca_key).unwrap();
        let error = LocalAuthority::sign_again(dir.path(), &["192.0.2.8".into()]);
        let error = error.unwrap_err().to_string();
        assert!(error.contains("ca.key is not the key of ca.pem"), "{error}");
        assert_eq!(text(CERTIFICATE), after[2]);
        fs::remove_file(dir.path().join(CA_KEY)).unwrap();
        let error = LocalAuthority::sign_again(dir.path(), &["192.0.2.8".into()]);
        assert!(matches!(error, Err(AuthorityError::Read { .. })));
    }

    #[test]
    fn a_name_that_no_client_can_use_is_refused() {
        for name in [
            "localhost",
            "192.0.2.7",
            "2001:db8::1",
            "*.lan",
            "a_b.example",
        ] {
            assert!(LocalAuthority::new(&[name.into()]).is_ok(), "{name}");
        }
        for name in [
            "bad name",
            "",
            "*",
            "host.",
            "https://host",
            "host:7071",
            "*.192.0.2.7",
        ] {
            let refused = LocalAuthority::new(&["localhost".into(), name.into()]);
            let error = refused.err().unwrap().to_string();
            assert!(
                error.starts_with(&format!("{name:?} is neither")),
                "{error}"
            );
        }
    }
}
