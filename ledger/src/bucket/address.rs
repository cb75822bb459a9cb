//! A store's address: `s3://BUCKET/PREFIX`, `gs://BUCKET/PREFIX`, `az://CONTAINER/PREFIX` or `file:///FOLDER`. Credentials are in variables
//! of the environment, whose names the crate `object_store` documents (`AWS_…`, `GOOGLE_…`, `AZURE_…`).

use crate::bucket::waiting::RetryPeriod;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::local::LocalFileSystem;
use object_store::path::Path as ObjectPath;
use object_store::signer::Signer;
use object_store::{ObjectStore, ObjectStoreScheme};
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use url::Url;
use zk0_files::atomic_file::create_folder;

/// Why a store cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum AddressError {
    /// The text is no address.
    #[error("{text:?} is not the address of a blob store ({why}): use s3://BUCKET/PREFIX, gs://BUCKET/PREFIX, az://CONTAINER/PREFIX or file:///FOLDER")]
    NoAddress {
        /// The text.
        text: String,
        /// What is wrong with it.
        why: String,
    },
    /// The address has a password.
    #[error("the address of a blob store holds no credentials: put them into variables of the environment (AWS_…, GOOGLE_…, AZURE_…)")]
    Credentials,
    /// A setting is missing or wrong.
    #[error("the blob store {address} cannot be opened: {error}")]
    Settings {
        /// The address.
        address: String,
        /// What is wrong.
        error: object_store::Error,
    },
    /// The folder cannot be made.
    #[error("{path}: {error}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What is wrong.
        error: io::Error,
    },
    /// There are no threads to talk to the store.
    #[error("the threads for the blob store cannot be started: {0}")]
    Threads(io::Error),
}

pub(super) struct OpenedStore {
    pub(super) address: String,
    pub(super) objects: Arc<dyn ObjectStore>,
    /// For requests that may take the store long.
    pub(super) long: Arc<dyn ObjectStore>,
    /// Signs addresses for others, if the store can.
    pub(super) signer: Option<Arc<dyn Signer>>,
    /// The start of all objects' names.
    pub(super) prefix: ObjectPath,
    /// The folder, if the store is one.
    pub(super) folder: Option<PathBuf>,
}

/// A store's clients: for most requests, for long ones, and to sign addresses, if it can.
type Clients = (
    Arc<dyn ObjectStore>,
    Arc<dyn ObjectStore>,
    Option<Arc<dyn Signer>>,
);

/// Makes a store's clients.
macro_rules! clients {
    ($builder:ty, $key:expr, $url:expr, $variables:expr, $prefix:expr, $patience:expr) => {{
        let mut builder = <$builder>::new();
        for (name, value) in $variables
            .iter()
            .filter(|(name, _)| name.starts_with($prefix))
        {
            if let Ok(key) = name.to_ascii_lowercase().parse() {
                builder = builder.with_config(key, value);
            }
        }
        use object_store::ClientConfigKey::{ConnectTimeout, Timeout};
        let millis = |time: std::time::Duration| format!("{}ms", time.as_millis());
        let builder = builder
            .with_config(($key)(ConnectTimeout), millis($patience.connect()))
            .with_retry($patience.retries())
            .with_url($url.as_str());
        let client = |longest| {
            let limited = builder.clone();
            let limited = limited.with_config(($key)(Timeout), millis(longest));
            limited.build().map(Arc::new)
        };
        client($patience.request()).and_then(|usual| {
            let signer: Arc<dyn Signer> = usual.clone();
            let clients: Clients = (usual, client($patience.0)?, Some(signer));
            Ok(clients)
        })
    }};
}

/// Opens the store at `text`. Sends no request.
pub(super) fn open(
    text: &str,
    variables: &[(String, String)],
    patience: RetryPeriod,
) -> Result<OpenedStore, AddressError> {
    let no_address = |why: String| AddressError::NoAddress {
        text: text.into(),
        why,
    };
    let url: Url = text
        .parse()
        .map_err(|error: url::ParseError| no_address(error.to_string()))?;
    if url.password().is_some() || url.query().is_some() {
        return Err(AddressError::Credentials);
    }
    let (scheme, prefix) =
        ObjectStoreScheme::parse(&url).map_err(|error| no_address(error.to_string()))?;
    let mut folder = None;
    let objects = match scheme {
        ObjectStoreScheme::AmazonS3 => clients!(
            AmazonS3Builder,
            object_store::aws::AmazonS3ConfigKey::Client,
            url,
            variables,
            "AWS_",
            patience
        ),
        ObjectStoreScheme::GoogleCloudStorage => clients!(
            GoogleCloudStorageBuilder,
            object_store::gcp::GoogleConfigKey::Client,
            url,
            variables,
            "GOOGLE_",
            patience
        ),
        ObjectStoreScheme::MicrosoftAzure => clients!(
            MicrosoftAzureBuilder,
            object_store::azure::AzureConfigKey::Client,
            url,
            variables,
            "AZURE_",
            patience
        ),
        ObjectStoreScheme::Local => {
            let path = url
                .to_file_path()
                .map_err(|()| no_address("it names no folder".into()))?;
            create_folder(&path).map_err(|error| AddressError::Folder {
                path: path.clone(),
                error,
            })?;
            folder = Some(path.clone());
            LocalFileSystem::new_with_prefix(path).map(|client| {
                let client: Arc<dyn ObjectStore> = Arc::new(client);
                (client.clone(), client, None)
            })
        }
        _ => {
            return Err(no_address(format!(
                "{} names no store of objects",
                url.scheme()
            )))
        }
    };
    let address = text.trim_end_matches('/').to_owned();
    let (objects, long, signer) = objects.map_err(|error| AddressError::Settings {
        address: address.clone(),
        error,
    })?;
    Ok(OpenedStore {
        address,
        objects,
        long,
        signer,
        // A folder's client begins in it.
        prefix: folder.as_ref().map_or(prefix, |_| ObjectPath::default()),
        folder,
    })
}
