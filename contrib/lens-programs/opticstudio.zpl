! Exports the lens that is open in Ansys Zemax OpticStudio for `camrig lens import`.
!
! To run:
!  1. Save the lens: the macro changes fields and wavelengths, and loads the file again at its end.
!  2. Open a Huygens PSF window, leave its settings linear, without polarisation, centroid and
!     normalisation, and press Save in its settings. That makes the settings file named below.
!  3. Edit FOLDER$, which must exist, and the settings that follow it; put this file among the
!     macros and run it.
!  4. camrig lens import FOLDER -o my-lens
! It leaves ISETPARMS.TXT, tables of the chief ray's height (mm), relative illumination and
! chief-ray angle (radians), and a Huygens PSF listing for each height and wavelength.
!
! Lenses in millimetres. Vignetting factors are removed, so that the chief ray goes through the
! middle of the stop: light is cut by apertures on the surfaces only. Give the surfaces the
! apertures that they have (Convert Semi-Diameters to Circular Apertures) before the export.
!
! What could not be run where this was written: OpticStudio itself. Keywords follow the public ZPL
! macro of ISETCam, and codes of SETSYSTEMPROPERTY and MODIFYSETTINGS the public documentation of
! PyZDDE. Decimal commas in the system's region can spoil HPS_IMAGEDELTA; the import then says that
! the spacing of the listings is another one. If a keyword is not known to your version, or a
! figure looks wrong, open an issue of camrig with the version of OpticStudio, the message,
! ISETPARMS.TXT and the first PSF listing.

FOLDER$ = "C:\camrig"
SETTINGS$ = $PATHNAME() + "\HPS.CFG"

! Base name of the files: letters, digits, - and _.
NAME$ = "lens"
! Image heights from the axis to the largest field, evenly spaced.
HEIGHTS = 21
! Largest field: angle of the chief ray at the entrance pupil, degrees.
MAXFIELD = 20
! PSF samples per side and their code: 32 is 1, 64 is 2, 128 is 3, 256 is 4, 512 is 5, 1024 is 6.
PSFSIZE = 128
PSFCODE = 3
! Distance of PSF samples, micrometres.
SPACING = 0.5
! Wavelengths, nm, rising; the same ones as text.
WAVES = 7
DECLARE WLN, DOUBLE, 1, 7
WLN(1) = 400
WLN(2) = 450
WLN(3) = 500
WLN(4) = 550
WLN(5) = 600
WLN(6) = 650
WLN(7) = 700
WAVES$ = "[400 450 500 550 600 650 700]"

UNITS$ = $UNITS()
MILLIMETRES = 0
IF (UNITS$ $== "MM") THEN MILLIMETRES = 1
IF (MILLIMETRES == 0)
    PRINT "the lens is not in millimetres: scale it first (Scale Lens)"
    END
ENDIF

LENS$ = $FILEPATH()
BASE$ = FOLDER$ + "\" + NAME$
PI = 4*ATAN(1)
IMGSURF = NSUR()

! One wavelength at a time, which is the primary one, so that a PSF is centred on its own chief ray.
REFUM = WAVL(PWAV())
SETSYSTEMPROPERTY 70, 2
SETSYSTEMPROPERTY 200, 1
SETSYSTEMPROPERTY 201, 1
SETSYSTEMPROPERTY 202, 1, REFUM
UPDATE

EFL = OPEV(OCOD("EFFL"), 0, 1, 0, 0, 0, 0)
FNUM = OPEV(OCOD("ISFN"), 0, 0, 0, 0, 0, 0)
WNUM = OPEV(OCOD("WFNO"), 0, 0, 0, 0, 0, 0)
EPD = OPEV(OCOD("EPDI"), 0, 0, 0, 0, 0, 0)
OBJDIST = THIC(0)
TANMAX = TANG(MAXFIELD*PI/180)
! FTOP: object height of the largest field (finite objects); DIRECTION: sign of the field whose
! image lies at +y.
IF (OBJDIST >= 1E10)
    MAG = 0
    FTOP = 0
    TOP = ABSO(EFL)*TANMAX
    DIRECTION = 1
    IF (EFL < 0) THEN DIRECTION = -1
ELSE
    MAG = OPEV(OCOD("PMAG"), 0, 1, 0, 0, 0, 0)
    FTOP = (OBJDIST + OPEV(OCOD("ENPP"), 0, 0, 0, 0, 0, 0))*TANMAX
    TOP = ABSO(MAG*FTOP)
    DIRECTION = 1
    IF (MAG < 0) THEN DIRECTION = -1
ENDIF
! The entrance pupil stays as it is at the reference wavelength.
IF (ATYP() == 1)
    SETSYSTEMPROPERTY 10, 0
    SETSYSTEMPROPERTY 11, EPD
ENDIF
IF (ATYP() == 4)
    SETSYSTEMPROPERTY 10, 0
    SETSYSTEMPROPERTY 11, EPD
ENDIF
! Field 1 is the axis, field 2 the one asked for: angles, or object heights of a finite object.
SETSYSTEMPROPERTY 101, 2
SETSYSTEMPROPERTY 100, 0
IF (OBJDIST < 1E10) THEN SETSYSTEMPROPERTY 100, 1
FOR F, 1, 2, 1
    FOR CODE, 105, 109, 1
        SETSYSTEMPROPERTY CODE, F, 0
    NEXT
    SETSYSTEMPROPERTY 102, F, 0
    SETSYSTEMPROPERTY 103, F, 0
NEXT
UPDATE

PARAMETERS$ = FOLDER$ + "\ISETPARMS.TXT"
OUTPUT PARAMETERS$
PRINT "lensFile='", NAME$, "';"
FORMAT .0
PRINT "psfSize=", PSFSIZE, ";"
FORMAT .9
PRINT "psfSpacing=", SPACING/1000, ";"
PRINT "wave=", WAVES$, ";"
FORMAT .0
PRINT "imgHeightNum=", HEIGHTS, ";"
FORMAT .9
PRINT "imgHeightMax=", TOP, ";"
PRINT "objDist=", OBJDIST, ";"
PRINT "mag=", MAG, ";"
PRINT "baseLensFileName='", NAME$, "';"
PRINT "refWave=", REFUM*1000, ";"
PRINT "fov=", MAXFIELD, ";"
PRINT "efl=", EFL, ";"
PRINT "fnumber_eff=", WNUM, ";"
PRINT "fnumber=", FNUM, ";"
OUTPUT SCREEN

! KIND 1: height of the chief ray, 2: relative illumination, 3: chief-ray angle.
FOR KIND, 1, 3, 1
    IF (KIND == 1) THEN FILE$ = BASE$ + "_DI_.dat"
    IF (KIND == 2) THEN FILE$ = BASE$ + "_RI_.dat"
    IF (KIND == 3) THEN FILE$ = BASE$ + "_CRA_.dat"
    OUTPUT FILE$
    FORMAT .8 EXP
    FOR I, 1, HEIGHTS, 1
        HY = 1
        IF (I == 1) THEN HY = 0
        PART = (I-1)/(HEIGHTS-1)
        FIELD = ATAN(PART*TANMAX)*180/PI
        IF (OBJDIST < 1E10) THEN FIELD = PART*FTOP
        SETSYSTEMPROPERTY 103, 2, DIRECTION*FIELD
        FOR J, 1, WAVES, 1
            SETSYSTEMPROPERTY 202, 1, WLN(J)/1000
            UPDATE
            IF (KIND == 1)
                VALUE = OPEV(OCOD("REAY"), IMGSURF, 1, 0, HY, 0, 0)
            ENDIF
            IF (KIND == 2)
                AXIS = OPEV(OCOD("RELI"), 30, 1, 1, 0, 0, 0)
                VALUE = OPEV(OCOD("RELI"), 30, 1, 2, 0, 0, 0)/AXIS
            ENDIF
            IF (KIND == 3)
                VALUE = ABSO(OPEV(OCOD("REAC"), IMGSURF, 1, 0, HY, 0, 0))
                IF (VALUE > 1) THEN VALUE = 1
                VALUE = ACOS(VALUE)
            ENDIF
            PRINT VALUE
        NEXT
    NEXT
    OUTPUT SCREEN
NEXT

! The image lies at -y, so that the rows of a listing, from +y down, run away from the axis.
MODIFYSETTINGS SETTINGS$, HPS_PUPILSAMP, PSFCODE
MODIFYSETTINGS SETTINGS$, HPS_IMAGESAMP, PSFCODE
MODIFYSETTINGS SETTINGS$, HPS_IMAGEDELTA, SPACING
MODIFYSETTINGS SETTINGS$, HPS_FIELD, 2
MODIFYSETTINGS SETTINGS$, HPS_WAVE, 1
MODIFYSETTINGS SETTINGS$, HPS_TYPE, 0
FOR I, 1, HEIGHTS, 1
    PART = (I-1)/(HEIGHTS-1)
    FIELD = ATAN(PART*TANMAX)*180/PI
    IF (OBJDIST < 1E10) THEN FIELD = PART*FTOP
    SETSYSTEMPROPERTY 103, 2, -DIRECTION*FIELD
    FOR J, 1, WAVES, 1
        SETSYSTEMPROPERTY 202, 1, WLN(J)/1000
        UPDATE
        FORMAT .0
        FILE$ = BASE$ + "_2D_PSF_Fld" + $STR(I) + "_Wave" + $STR(J) + ".dat"
        PRINT FILE$
        GETTEXTFILE FILE$, Hps, SETTINGS$, 1
    NEXT
NEXT

LOADLENS LENS$
PRINT "done: camrig lens import ", FOLDER$, " -o ", NAME$
