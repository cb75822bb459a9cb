//! A certificate authority for tests and local networks, and a server's certificate that it signs.

use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DistinguishedName, DnType,
    ExtendedKeyUsagePurpose, IsCa, KeyPair, KeyUsagePurpose,
};
use rustls::pki_types::ServerName;
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
    /// No client could use a certificate for this name.
    #[error("{0:?} is neither a host name nor an IP address: give a name by which clients reach the server, without a scheme and a port")]
    Name(String),
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
        if let Some(unusable) = names.iter().find(|name| !is_server_name(name)) {
            return Err(AuthorityError::Name(unusable.clone()));
        }
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

/// Whether a client can find this name in a certificate. `*.` before a host name stands for all hosts of a domain.
fn is_server_name(name: &str) -> bool {
    let host = name.strip_prefix("*.").unwrap_or(name);
    match ServerName::try_from(host) {
        // With a dot at its end, a client may ask for a host, but no certificate may name it.
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
