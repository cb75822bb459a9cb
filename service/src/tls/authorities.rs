//! Whose certificates a client believes, and errors about others.

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::CertificateDer;
use rustls::{AlertDescription, CertificateError};
use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};
use zk0_files::bounded_file;

/// Largest file of certificates read.
const MAX_CA_BYTES: u64 = 1 << 20;

/// The authorities that may sign a server's certificate: those in a file, or the system's.
#[derive(Clone, Debug)]
pub struct Authorities {
    file: Option<PathBuf>,
    /// The option that names the file.
    option: &'static str,
}

/// Why there are no authorities.
#[derive(Debug, thiserror::Error)]
pub enum AuthoritiesError {
    /// The file is unusable.
    #[error("{} cannot be used to check certificates: {error}", .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The fault.
        error: io::Error,
    },
    /// The system trusts none.
    #[error("this system has no certificates of authorities: install the package ca-certificates, or name a file with {option}")]
    NoneInSystem {
        /// The option with the file.
        option: &'static str,
    },
}

impl Authorities {
    /// The system's authorities. `option` names a file with others.
    pub fn of_system(option: &'static str) -> Self {
        Self { file: None, option }
    }

    /// Uses the authorities of this file, if any.
    pub fn in_file(mut self, file: Option<PathBuf>) -> Self {
        self.file = file;
        self
    }

    /// The authorities' file.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// Their certificates, at least one.
    ///
    /// # Errors
    /// The file or the system has none.
    pub fn certificates(&self) -> Result<Vec<CertificateDer<'static>>, AuthoritiesError> {
        let found = match &self.file {
            Some(path) => read(path).map_err(|error| AuthoritiesError::File {
                path: path.clone(),
                error,
            })?,
            None => rustls_native_certs::load_native_certs().certs,
        };
        if found.is_empty() {
            Err(self.unusable())
        } else {
            Ok(found)
        }
    }

    /// None of their certificates is usable.
    pub fn unusable(&self) -> AuthoritiesError {
        match &self.file {
            Some(path) => AuthoritiesError::File {
                path: path.clone(),
                error: io::Error::other("none of its certificates can be read"),
            },
            None => AuthoritiesError::NoneInSystem {
                option: self.option,
            },
        }
    }

    /// What a TLS failure means to a client.
    pub fn meaning(&self, error: &rustls::Error) -> String {
        let trusted = match &self.file {
            Some(path) => format!("a certificate in {}", path.display()),
            None => format!(
                "an authority that this machine trusts: name the right one with {}",
                self.option
            ),
        };
        use rustls::Error::{AlertReceived, InvalidCertificate, InvalidMessage};
        match error {
            InvalidCertificate(
                CertificateError::UnknownIssuer | CertificateError::BadSignature,
            ) => {
                format!("its certificate is not signed by {trusted}")
            }
            InvalidCertificate(
                error @ (CertificateError::Expired
                | CertificateError::ExpiredContext { .. }
                | CertificateError::NotValidYet
                | CertificateError::NotValidYetContext { .. }),
            ) => format!(
                "its certificate is not valid now: {error}; or the clock of this machine is wrong"
            ),
            InvalidCertificate(
                error @ (CertificateError::NotValidForName
                | CertificateError::NotValidForNameContext { .. }),
            ) => format!("its certificate is for another name: {error}"),
            InvalidCertificate(error) => format!("its certificate is refused: {error}"),
            InvalidMessage(_) => "it does not speak TLS: use http:// if that is right".into(),
            AlertReceived(AlertDescription::NoApplicationProtocol) => {
                "it speaks TLS, but another protocol inside it: is this the address of another service?".into()
            }
            other => other.to_string(),
        }
    }
}

/// An error and its causes.
pub fn causes<'a>(
    error: &'a (dyn Error + 'static),
) -> impl Iterator<Item = &'a (dyn Error + 'static)> {
    std::iter::successors(Some(error), |&error| error.source())
}

/// The TLS failure among an error's causes.
pub fn tls_error<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a rustls::Error> {
    causes(error).find_map(|cause| {
        let inner = cause
            .downcast_ref::<io::Error>()
            .and_then(io::Error::get_ref);
        let inner = inner.and_then(|inner| inner.downcast_ref());
        inner.or_else(|| cause.downcast_ref())
    })
}

fn read(path: &Path) -> io::Result<Vec<CertificateDer<'static>>> {
    let text = bounded_file::read(path, MAX_CA_BYTES)?;
    let certificates: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&text).collect();
    match certificates {
        Ok(certificates) if !certificates.is_empty() => Ok(certificates),
        _ => Err(io::Error::other("it is not a PEM file with certificates")),
    }
}
