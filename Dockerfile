# dfdbench in a container, for people and for checking submissions: docs/releasing.md, CONTRIBUTING.md.
#   docker build -t dfdbench .                        with the networks: --build-arg EXTRAS=nets
#   docker run --rm -v "$PWD:/work" dfdbench list
FROM python:3.11-slim
ARG EXTRAS=""
WORKDIR /src
COPY constraints.txt pyproject.toml setup.py MANIFEST.in README.md LICENSE ./
COPY dfdbench dfdbench
COPY manifests manifests
COPY leaderboard leaderboard
RUN pip install --no-cache-dir --constraint constraints.txt ".${EXTRAS:+[$EXTRAS]}" \
    && rm -rf /src/* \
    && useradd --create-home --uid 1000 dfdbench
USER 1000
ENV DFDBENCH_CACHE=/home/dfdbench/cache
WORKDIR /work
ENTRYPOINT ["dfdbench"]
