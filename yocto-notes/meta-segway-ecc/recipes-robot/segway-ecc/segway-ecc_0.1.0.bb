SUMMARY = "Runs a control model on a two-wheeled robot: fixed rate, CAN drives, ROS 2"
DESCRIPTION = "Fixed-rate control loop, drives over CAN with a serial line to fall back on, guard, recorder and base station."
SECTION = "robotics"
LICENSE = "MIT"
LIC_FILES_CHKSUM = "file://LICENSE;md5=9ac2309765cf7d7c8532ec6987c2f1af"

SRC_URI = "\
    git://${SEGWAY_ECC_CHECKOUT};protocol=file;branch=${SEGWAY_ECC_BRANCH} \
    file://ros.conf.in \
    file://segway-ecc-ros.sh.in \
"
# The layer is part of the checkout that it builds, so the revision cannot be written down in it.
# nooelint: oelint.vars.autorev
SRCREV = "${AUTOREV}"

S = "${WORKDIR}/git"

inherit python_hatchling systemd useradd

ROS_PREFIX = "/opt/ros/${ROS_DISTRO}"

# hatchling of this release knows neither a licence written as one expression nor a list of licence files.
do_configure:prepend() {
    sed -i \
        -e 's/^requires = \["hatchling[^"]*"\]$/requires = ["hatchling"]/' \
        -e 's/^license = "MIT"$/license = { text = "MIT" }/' \
        -e '/^license-files = /d' \
        ${S}/pyproject.toml
}

do_install:append() {
    install -d ${D}${sysconfdir}/segway-ecc
    install -d ${D}${sysconfdir}/profile.d
    install -d ${D}${nonarch_base_libdir}/udev/rules.d
    install -d ${D}${nonarch_libdir}/tmpfiles.d
    install -d ${D}${systemd_system_unitdir}
    install -d ${D}${systemd_unitdir}/network

    for unit in ${SEGWAY_ECC_UNITS}; do
        sed -e 's:/opt/segway-ecc/current/venv/bin/:${bindir}/:g' \
            -e '/^EnvironmentFile=-.opt.segway-ecc.current/d' \
            ${S}/deploy/systemd/$unit > ${D}${systemd_system_unitdir}/$unit
        chmod 0644 ${D}${systemd_system_unitdir}/$unit
    done
    if grep -rn '/opt/segway-ecc' ${D}${systemd_system_unitdir}; then
        bbfatal "a unit still names a release directory, which this image has not"
    fi

    for unit in ${SEGWAY_ECC_ROS_UNITS}; do
        install -d ${D}${systemd_system_unitdir}/$unit.d
        sed -e 's:@ROS_PREFIX@:${ROS_PREFIX}:g' -e 's:@LIB@:${baselib}:g' -e 's:@PYTHON_DIR@:${PYTHON_DIR}:g' \
            ${WORKDIR}/ros.conf.in > ${D}${systemd_system_unitdir}/$unit.d/10-ros.conf
    done
    sed -e 's:@ROS_PREFIX@:${ROS_PREFIX}:g' -e 's:@LIB@:${baselib}:g' -e 's:@PYTHON_DIR@:${PYTHON_DIR}:g' \
        ${WORKDIR}/segway-ecc-ros.sh.in > ${D}${sysconfdir}/profile.d/segway-ecc-ros.sh

    install -m 0644 ${S}/deploy/network/*.link ${D}${systemd_unitdir}/network
    install -m 0644 ${S}/deploy/network/*.network ${D}${systemd_unitdir}/network
    install -m 0644 ${S}/deploy/systemd/segway-ecc.tmpfiles.conf ${D}${nonarch_libdir}/tmpfiles.d/segway-ecc.conf
    install -m 0644 ${S}/deploy/udev/*.rules ${D}${nonarch_base_libdir}/udev/rules.d
}

PACKAGES =+ "${PN}-canopen ${PN}-ros ${PN}-station"

FILES:${PN} += "\
    ${nonarch_base_libdir}/udev \
    ${nonarch_libdir}/tmpfiles.d \
    ${systemd_system_unitdir} \
    ${systemd_unitdir}/network \
"
FILES:${PN}-ros += "\
    ${sysconfdir}/profile.d/segway-ecc-ros.sh \
    ${systemd_system_unitdir}/*.d/10-ros.conf \
"
FILES:${PN}-station += "${systemd_system_unitdir}/segway-ecc-station.service"

ALLOW_EMPTY:${PN}-canopen = "1"

# python3-modules: the whole standard library, so that nothing is found missing while the robot runs.
RDEPENDS:${PN} += "\
    python3-can \
    python3-mcap \
    python3-modules \
    python3-msgspec \
    python3-mypy-extensions \
    python3-numpy \
    python3-pyserial \
    python3-pyyaml \
"
RDEPENDS:${PN}-canopen = "\
    ${PN} \
    python3-canopen \
"
RDEPENDS:${PN}-ros = "\
    ${PN} \
    diagnostic-msgs \
    geometry-msgs \
    nav-msgs \
    rclpy \
    rmw-fastrtps-cpp \
    sensor-msgs \
    std-msgs \
    std-srvs \
    tf2-msgs \
    trajectory-msgs \
"
RDEPENDS:${PN}-station = "\
    ${PN} \
    python3-aiohttp \
"

# The same user as in deploy/systemd/segway-ecc.sysusers.conf, made here because the root cannot be written at boot.
USERADD_PACKAGES = "${PN}"
USERADD_PARAM:${PN} = "\
    --system --user-group --groups dialout \
    --no-create-home --home-dir ${localstatedir}/lib/segway-ecc --shell ${base_sbindir}/nologin segway \
"

SEGWAY_ECC_ROS_UNITS = "segway-ecc-archive.service segway-ecc-node.service segway-ecc-station.service"
SEGWAY_ECC_UNITS = "${SYSTEMD_SERVICE:${PN}} ${SYSTEMD_SERVICE:${PN}-station}"

SYSTEMD_PACKAGES = "${PN} ${PN}-station"
SYSTEMD_SERVICE:${PN} = "segway-ecc-archive.service segway-ecc-guard.service segway-ecc-node.service segway-ecc.target"
SYSTEMD_SERVICE:${PN}-station = "segway-ecc-station.service"
# A base station is switched on by the person who sets one up.
SYSTEMD_AUTO_ENABLE:${PN}-station = "disable"
