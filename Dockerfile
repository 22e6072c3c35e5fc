# syntax=docker/dockerfile:1
# wiclosure with its viewer's recordings, from Debian slim; no screen is needed.
#   docker build --tag wiclosure .
#   docker run --rm --volume "$PWD:/data" wiclosure run dataset.yaml
FROM debian:12-slim AS build
RUN apt-get update \
    && apt-get install --yes --no-install-recommends python3=3.11.* python3-venv=3.11.* \
    && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /opt/wiclosure
COPY . /source
# The pins make two builds alike; the version of pip is that of Debian.
RUN /opt/wiclosure/bin/pip install --no-cache-dir --disable-pip-version-check \
    --constraint /source/constraints.txt '/source[viz,pandas,draco,las,cbor,kiss-matcher]'

FROM debian:12-slim
# What open3d links against.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends \
        libegl1 libgl1 libgomp1 libudev1 libusb-1.0-0 libx11-6 python3=3.11.* \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home --uid 1000 user
COPY --from=build /opt/wiclosure /opt/wiclosure
ENV PATH=/opt/wiclosure/bin:$PATH \
    WICLOSURE_CACHE=/tmp/wiclosure
USER 1000
WORKDIR /data
ENTRYPOINT ["wiclosure"]
CMD ["--help"]
